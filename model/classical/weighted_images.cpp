#include "model/classical/weighted_images.h"

#include <utility>

#include "core/display.h"
#include "core/parallel.h"
#include "model/picture_sum.h"

namespace lightstage::model {

WeightedImages::WeightedImages(std::string name, const core::OlatScan& scan, Domain domain, Weights weights)
    : name_(std::move(name)),
      scan_(scan),
      summed_(domain == Domain::kDisplay ? scan.display_encoded() : scan),
      domain_(domain),
      weights_(std::move(weights)) {}

void WeightedImages::prepare() const {
  if (domain_ == Domain::kLinear) return;
  if (summed_.light_count() > summed_.images_kept()) return;
  core::parallel_for(summed_.light_count(), 1, [&](std::size_t first, std::size_t last) {
    for (std::size_t i = first; i < last; ++i) summed_.image(i);
  });
}

core::Image WeightedImages::render(const core::Direction& query) const {
  PictureSum sum(summed_.image_size());
  sum.add(summed_, weights_(query));
  core::Image picture = sum.result();
  if (domain_ == Domain::kLinear) return picture;
  const double exposure = scan_.exposure();
  core::parallel_for(picture.values().size(), 1 << 14, [&](std::size_t first, std::size_t last) {
    for (float& v : picture.values().subspan(first, last - first))
      v = static_cast<float>(exposure * core::display_decode(v));
  });
  return picture;
}

std::vector<double> WeightedImages::linear_weights(const core::Direction& query) const {
  return domain_ == Domain::kLinear ? weights_(query) : std::vector<double>();
}

}  // namespace lightstage::model
