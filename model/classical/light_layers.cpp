#include "model/classical/light_layers.h"

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>

#include "core/parallel.h"
#include "core/sphere.h"

namespace lightstage::model {

namespace {

constexpr std::size_t kGrain = 4096;  // pixels

// What is known of a pixel under a light, as 8-bit values whose order is kept by a median.
constexpr uchar kShadow = 0, kUnknown = 128, kLit = 255;

double mean_of(const float* values, int channels) {
  double sum = 0;
  for (int c = 0; c < channels; ++c) sum += double(values[c]);
  return sum / channels;
}

// How far each pixel is from the nearest one of this state, pixels; very far where there is none.
cv::Mat_<float> distance_to(const cv::Mat_<uchar>& states, uchar state) {
  const cv::Mat others = states != state;
  cv::Mat_<float> distance;
  if (cv::countNonZero(others) == int(states.total()))
    distance = cv::Mat_<float>(states.size(), 1e6F);
  else
    cv::distanceTransform(others, distance, cv::DIST_L2, cv::DIST_MASK_PRECISE);
  return distance;
}

}  // namespace

LightLayers::LightLayers(const core::OlatScan& scan)
    : scan_(scan),
      surface_(estimate_normals(scan)),
      // A subject of n pixels is about sqrt(n) of them wide, and its shadows fall over about half of that.
      shadow_reach_(std::max(
          3.0, 0.5 * core::median_spacing_radians(scan.directions()) * std::sqrt(double(scan.masked_pixel_count())))) {}

core::Image LightLayers::diffuse(const core::Direction& direction) const {
  core::Image result(surface_.albedo);
  const int channels = result.channels();
  core::parallel_for(result.values().size() / std::size_t(channels), kGrain, [&](std::size_t first, std::size_t last) {
    for (std::size_t pixel = first; pixel < last; ++pixel) {
      const float* n = surface_.normals.values().data() + 3 * pixel;
      const double cosine =
          std::max(0.0, double(n[0]) * direction.x() + double(n[1]) * direction.y() + double(n[2]) * direction.z());
      float* values = result.values().data() + pixel * std::size_t(channels);
      for (int c = 0; c < channels; ++c) values[c] = float(cosine * double(values[c]));
    }
  });
  return result;
}

Layers LightLayers::of(std::size_t light) const {
  const auto picture = scan_.image(light);
  Layers layers{diffuse(scan_.directions()[light]), core::Image(*picture), {}};
  const std::span<const float> diffuse = layers.diffuse.values();
  const std::span<float> highlights = layers.highlights.values();
  for (std::size_t v = 0; v < highlights.size(); ++v) highlights[v] = std::max(0.0F, highlights[v] - diffuse[v]);
  layers.shadow_distance = shadow_distance(layers.diffuse, *picture);
  return layers;
}

core::Image LightLayers::shadow_distance(core::ImageView diffuse, core::ImageView picture) const {
  // A diffuse layer below this share of the albedo, or of what is shown as white, tells nothing.
  constexpr double kGrazing = 0.1, kBlack = 0.01;
  const int channels = diffuse.channels();
  const double black = kBlack * scan_.exposure();
  cv::Mat_<uchar> states(diffuse.height(), diffuse.width());
  for (int y = 0; y < states.rows; ++y) {
    for (int x = 0; x < states.cols; ++x) {
      const double should = mean_of(diffuse.pixel(y, x), channels), is = mean_of(picture.pixel(y, x), channels);
      const bool known = should > kGrazing * mean_of(surface_.albedo.pixel(y, x), channels) && should > black;
      states(y, x) = !known ? kUnknown : is < 0.5 * should ? kShadow : kLit;
    }
  }
  if (states.rows >= 3 && states.cols >= 3) cv::medianBlur(states, states, 3);
  const cv::Mat_<float> to_shadow = distance_to(states, kShadow), to_lit = distance_to(states, kLit);
  core::Image result(states.rows, states.cols, 1);
  for (int y = 0; y < states.rows; ++y) {
    for (int x = 0; x < states.cols; ++x) {
      // The edge runs half way between a pixel in the light and its neighbour in shadow.
      const double beyond = states(y, x) == kLit ? -0.5 : states(y, x) == kShadow ? 0.5 : 0.0;
      const double distance = double(to_shadow(y, x)) - double(to_lit(y, x)) + beyond;
      result(y, x) = float(std::clamp(distance, -shadow_reach_, shadow_reach_));
    }
  }
  return result;
}

}  // namespace lightstage::model
