#include "model/classical/photometric_stereo.h"

#include <algorithm>
#include <limits>

#include "model/classical/layers_between.h"

namespace lightstage::model {

namespace {

class PhotometricStereo : public LightInterpolator {
 public:
  explicit PhotometricStereo(const core::OlatScan& scan) : layers_(scan) {}

  std::string_view name() const override { return "photometric_stereo"; }
  const core::OlatScan& scan() const override { return layers_.scan(); }

  core::Image render(const core::Direction& query) const override {
    const LayersBetween between = layers_between(layers_, query);
    core::Image picture(scan().image_size());
    const std::size_t channels = std::size_t(picture.channels());
    for (std::size_t v = 0; v < picture.values().size(); ++v) {
      constexpr double kLargest = std::numeric_limits<float>::max();
      const double visible = double(between.visibility.values()[v / channels]);
      const double value = double(between.diffuse.values()[v]) * visible + double(between.highlights.values()[v]);
      picture.values()[v] = float(std::min(value, kLargest));
    }
    return picture;
  }

 private:
  LightLayers layers_;
};

}  // namespace

std::unique_ptr<LightInterpolator> make_photometric_stereo(const core::OlatScan& scan) {
  return std::make_unique<PhotometricStereo>(scan);
}

}  // namespace lightstage::model
