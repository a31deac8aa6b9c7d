#include "model/classical/weighted_images.h"

#include <utility>

#include "core/display.h"
#include "core/parallel.h"
#include "model/picture_sum.h"

namespace lightstage::model {

namespace {

constexpr std::size_t kEncodedBytes = std::size_t(4) << 30;

core::OlatScan display_encoded(const core::OlatScan& scan) {
  const double exposure = scan.exposure();
  std::vector<core::Light> lights;
  for (std::size_t i = 0; i < scan.light_count(); ++i) lights.push_back(scan.light(i));
  auto encode = [scan, exposure](std::size_t light_index) {
    core::Image image = *scan.image(light_index);
    for (float& v : image.values()) v = core::display_encode(static_cast<float>(v / exposure));
    return image;
  };
  return core::OlatScan(scan.name(), std::move(lights), scan.image_size(), scan.mask(), std::move(encode),
                        kEncodedBytes);
}

}  // namespace

WeightedImages::WeightedImages(std::string name, const core::OlatScan& scan, Domain domain, Weights weights)
    : name_(std::move(name)),
      scan_(scan),
      summed_(domain == Domain::kDisplay ? display_encoded(scan) : scan),
      domain_(domain),
      weights_(std::move(weights)) {}

void WeightedImages::prepare() const {
  if (domain_ == Domain::kLinear) return;
  if (summed_.light_count() > kEncodedBytes / (summed_.image_size().value_count() * sizeof(float))) return;
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
