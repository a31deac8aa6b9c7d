#include "model/interpolator.h"

#include "model/classical/ordered_sum.h"
#include "model/picture_sum.h"

namespace lightstage::model {

std::vector<double> LightInterpolator::linear_weights(const core::Direction&) const {
  return {};
}

std::vector<core::Vec3> LightInterpolator::captured_colours(std::span<const DistantLight> lights) const {
  if (linear_weights(core::Direction()).empty()) return {};
  return ordered_sum(lights.size(), scan().light_count(), [&](std::size_t q, std::vector<core::Vec3>& colours) {
    const std::vector<double> weights = linear_weights(lights[q].direction);
    for (std::size_t i = 0; i < weights.size(); ++i)
      if (weights[i] != 0) colours[i] = colours[i] + weights[i] * lights[q].irradiance;
  });
}

core::Image LightInterpolator::lit_by(std::span<const core::Vec3> colours) const {
  const core::ImageSize size = scan().image_size();
  PictureSum sum({size.height, size.width, 3});
  sum.add(scan(), colours);
  return sum.result();
}

}  // namespace lightstage::model
