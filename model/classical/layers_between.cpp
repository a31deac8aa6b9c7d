#include "model/classical/layers_between.h"

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>

#include "core/parallel.h"
#include "core/sphere.h"
#include "model/alias_free_weights.h"
#include "model/classical/highlight_motion.h"

namespace lightstage::model {

namespace {

std::vector<NearLight> lights_around(const LightLayers& layers, const core::Direction& query) {
  // More are less noisy, fewer are sharper, and the time goes with the square: docs/model.md.
  constexpr std::size_t kNeighbours = 6;
  const std::vector<core::Direction>& all = layers.scan().directions();
  const std::vector<std::size_t> nearest = core::nearest_indices(all, query, kNeighbours);
  std::vector<core::Direction> directions;
  for (const std::size_t light : nearest) directions.push_back(all[light]);
  const std::vector<double> weights =
      alias_free_weights(query, directions, default_sharpness(core::median_spacing_radians(all)));
  std::vector<NearLight> lights;
  for (std::size_t i = 0; i < nearest.size(); ++i)
    if (weights[i] > 0) lights.push_back({nearest[i], weights[i], {}});
  core::parallel_for(lights.size(), 1, [&](std::size_t first, std::size_t last) {
    for (std::size_t i = first; i < last; ++i) lights[i].layers = layers.of(lights[i].light);
  });
  return lights;
}

void add(core::Image& sum, double weight, const core::Image& image) {
  for (std::size_t v = 0; v < sum.values().size(); ++v) sum.values()[v] += float(weight) * image.values()[v];
}

core::Image highlights_between(const std::vector<NearLight>& lights, double white) {
  const core::ImageSize size = lights.front().layers.highlights.size();
  std::vector<core::Image> brought(lights.size());
  core::parallel_for(lights.size(), 1, [&](std::size_t first, std::size_t last) {
    for (std::size_t i = first; i < last; ++i) {
      core::Image displacement(size.height, size.width, 2);
      for (std::size_t j = 0; j < lights.size(); ++j) {
        if (j == i) continue;
        add(displacement, lights[j].weight,
            highlight_flow(lights[i].layers.highlights, lights[j].layers.highlights, white));
      }
      brought[i] = moved(lights[i].layers.highlights, displacement);
    }
  });
  core::Image result(size);
  for (std::size_t i = 0; i < lights.size(); ++i) add(result, lights[i].weight, brought[i]);
  return result;
}

// How deep the lit and the shadowed parts around each pixel are, the lesser of the two; half a pixel where there is nothing but one of them.
core::Image depth_around(const std::vector<NearLight>& lights, double reach) {
  constexpr double kShallowest = 0.5;
  const core::Image& first = lights.front().layers.shadow_distance;
  const int radius = std::max(1, int(std::lround(reach)));
  const cv::Mat around = cv::Mat::ones(2 * radius + 1, 2 * radius + 1, CV_8U);
  cv::Mat_<float> lit(first.height(), first.width(), 0.0F), shadowed = lit.clone();
  for (const NearLight& light : lights) {
    cv::Mat_<float> distance(first.height(), first.width());
    std::copy_n(light.layers.shadow_distance.pixel(0, 0), distance.total(), distance.begin());
    cv::Mat_<float> deepest;
    cv::dilate(distance, deepest, around);
    lit += light.weight * cv::max(deepest, kShallowest);
    cv::dilate(-distance, deepest, around);
    shadowed += light.weight * cv::max(deepest, kShallowest);
  }
  core::Image result(first.height(), first.width(), 1);
  for (int y = 0; y < result.height(); ++y)
    for (int x = 0; x < result.width(); ++x) result(y, x) = std::min(lit(y, x), shadowed(y, x));
  return result;
}

core::Image visibility_between(const std::vector<NearLight>& lights, double reach) {
  constexpr double kSoftness = 0.6;  // measured: docs/model.md
  core::Image result = depth_around(lights, reach);
  std::vector<double> distances(lights.size());
  for (std::size_t pixel = 0; pixel < result.values().size(); ++pixel) {
    const double depth = double(result.values()[pixel]);
    double mean = 0, spread = 0;
    for (std::size_t i = 0; i < lights.size(); ++i) {
      distances[i] = std::clamp(double(lights[i].layers.shadow_distance.values()[pixel]), -depth, depth);
      mean += lights[i].weight * distances[i];
    }
    for (std::size_t i = 0; i < lights.size(); ++i) spread += lights[i].weight * std::abs(distances[i] - mean);
    result.values()[pixel] = float(visibility(mean / (1 + kSoftness * spread)));
  }
  return result;
}

}  // namespace

LayersBetween layers_between(const LightLayers& scan, const core::Direction& query) {
  LayersBetween between;
  between.lights = lights_around(scan, query);
  between.diffuse = scan.diffuse(query);
  between.highlights = highlights_between(between.lights, scan.scan().exposure());
  between.visibility = visibility_between(between.lights, scan.shadow_reach());
  return between;
}

}  // namespace lightstage::model
