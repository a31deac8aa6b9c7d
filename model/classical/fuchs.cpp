#include "model/classical/fuchs.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "core/display.h"
#include "core/parallel.h"
#include "model/classical/layers_between.h"

namespace lightstage::model {

namespace {

class Fuchs : public LightInterpolator {
 public:
  explicit Fuchs(const core::OlatScan& scan) : layers_(scan), exposure_(scan.exposure()) {}

  std::string_view name() const override { return "fuchs"; }
  const core::OlatScan& scan() const override { return layers_.scan(); }

  core::Image render(const core::Direction& query) const override {
    const LayersBetween between = layers_between(layers_, query);
    std::vector<std::shared_ptr<const core::Image>> captured;
    for (const NearLight& near : between.lights) captured.push_back(scan().image(near.light));
    core::Image picture(scan().image_size());
    constexpr std::size_t kGrain = 4096;
    core::parallel_for(between.visibility.values().size(), kGrain, [&](std::size_t first, std::size_t last) {
      std::vector<double> visible(captured.size()), weights(captured.size());
      for (std::size_t pixel = first; pixel < last; ++pixel) {
        const double to_be_visible = double(between.visibility.values()[pixel]);
        weigh(between.lights, pixel, to_be_visible, visible, weights);
        for (int c = 0; c < picture.channels(); ++c) {
          const std::size_t v = pixel * std::size_t(picture.channels()) + std::size_t(c);
          double sum = modelled(between.diffuse, between.highlights, to_be_visible, v);
          for (std::size_t i = 0; i < captured.size(); ++i) {
            const Layers& layers = between.lights[i].layers;
            sum += weights[i] * (encoded(double(captured[i]->values()[v])) -
                                 modelled(layers.diffuse, layers.highlights, visible[i], v));
          }
          picture.values()[v] = decoded(sum);
        }
      }
    });
    return picture;
  }

 private:
  // W', and the visibility at each light.
  static void weigh(const std::vector<NearLight>& lights, std::size_t pixel, double to_be_visible,
                    std::vector<double>& visible, std::vector<double>& weights) {
    constexpr double kOtherState = 0.02;  // where no light sees the pixel as it is to be
    constexpr double kOnEdge = 0.02;      // where all of them have an edge there
    double sum = 0;
    for (std::size_t i = 0; i < lights.size(); ++i) {
      const double distance = double(lights[i].layers.shadow_distance.values()[pixel]);
      visible[i] = visibility(distance);
      const double alike = to_be_visible * visible[i] + (1 - to_be_visible) * (1 - visible[i]);
      const double clear_of_edge = std::clamp(std::abs(distance) - 0.5, kOnEdge, 1.0);
      weights[i] = lights[i].weight * (alike + kOtherState) * clear_of_edge;
      sum += weights[i];
    }
    for (double& weight : weights) weight /= sum;
  }

  // In float64, where no ratio of floats overflows.
  double encoded(double linear) const { return linear > 0 ? std::pow(linear / exposure_, 1 / core::kDisplayGamma) : 0; }
  float decoded(double value) const {
    constexpr double kLargest = std::numeric_limits<float>::max();
    return value > 0 ? float(std::min(exposure_ * std::pow(value, core::kDisplayGamma), kLargest)) : 0.0F;
  }

  double modelled(const core::Image& diffuse, const core::Image& highlights, double visible, std::size_t v) const {
    const double highlight = double(highlights.values()[v]);
    const double lit = visible > 0 ? visible * encoded(double(diffuse.values()[v]) + highlight) : 0;
    return visible < 1 ? lit + (1 - visible) * encoded(highlight) : lit;
  }

  LightLayers layers_;
  double exposure_;
};

}  // namespace

std::unique_ptr<LightInterpolator> make_fuchs(const core::OlatScan& scan) {
  return std::make_unique<Fuchs>(scan);
}

}  // namespace lightstage::model
