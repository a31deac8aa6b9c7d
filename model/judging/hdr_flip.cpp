// Andersson, Nilsson, Shirley and Akenine-Moeller 2021, "Visualizing errors in rendered high dynamic range images".
#include <algorithm>
#include <cmath>
#include <vector>

#include "core/display.h"
#include "core/parallel.h"
#include "model/flip.h"
#include "model/judging/comparison.h"
#include "model/metrics.h"

namespace lightstage::model {

namespace {

// The tone mapper that the publication takes: Narkowicz's fit to ACES, with the exposure of 0.6 that belongs to it.
constexpr double kToneExposure = 0.6;

double tone_mapped(double radiance) {
  constexpr double kWhite = 1e30;  // far beyond it already; the exposed values of hot pixels may overflow
  const double v = kToneExposure * std::min(radiance, kWhite);
  return std::clamp(v * (2.51 * v + 0.03) / (v * (2.43 * v + 0.59) + 0.14), 0.0, 1.0);
}

// The radiance that is shown as `value`: the positive root of tone_mapped(r) = value.
double radiance_shown_as(double value) {
  const double a = 2.51 - 2.43 * value, b = 0.03 - 0.59 * value, c = -0.14 * value;
  return (-b + std::sqrt(b * b - 4 * a * c)) / (2 * a) / kToneExposure;
}

std::vector<float> masked_luminance(const Comparison& pair, core::ImageView picture) {
  const core::Image luminance = core::to_luminance(picture);
  std::vector<float> values;
  for (int y = 0; y < picture.height(); ++y)
    for (int x = 0; x < picture.width(); ++x)
      if (pair.inside(y, x)) values.push_back(std::max(0.0f, luminance(y, x)));
  return values;
}

// At `stops`, as flip_map takes it.
core::Image shown(core::ImageView radiance, double stops) {
  core::Image result = core::expose(radiance, stops);
  core::parallel_for(result.values().size(), 1 << 14, [&](std::size_t first, std::size_t last) {
    for (float& v : result.values().subspan(first, last - first))
      v = core::display_encode(static_cast<float>(tone_mapped(std::max(0.0, double(v)))));
  });
  return result;
}

}  // namespace

std::vector<double> hdr_flip_stops(core::ImageView truth, core::ImageView picture, core::ImageView mask) {
  constexpr double kShownAs = 0.85, kLargestRange = 12;
  const Comparison pair(truth, picture, mask);
  std::vector<float> luminance = masked_luminance(pair, truth);
  if (core::quantile(luminance, 1) <= 0) luminance = masked_luminance(pair, picture);
  const double largest = core::quantile(luminance, 1);
  if (largest <= 0) return {0.0};
  const double median = std::max(core::quantile(luminance, 0.5), largest * std::exp2(-kLargestRange));
  const double radiance = radiance_shown_as(kShownAs);
  const double first = std::log2(radiance / largest), last = std::log2(radiance / median);
  const int count = std::max(2, static_cast<int>(std::ceil(last - first)));
  std::vector<double> stops;
  for (int i = 0; i < count; ++i) stops.push_back(first + (last - first) * i / (count - 1));
  return stops;
}

double hdr_flip(core::ImageView truth, core::ImageView picture, core::ImageView mask) {
  const Comparison pair(truth, picture, mask);
  core::Image largest(truth.height(), truth.width(), 1);
  for (const double stops : hdr_flip_stops(truth, picture, mask)) {
    const core::Image map = flip_map(shown(truth, stops), shown(picture, stops));
    for (std::size_t i = 0; i < map.values().size(); ++i)
      largest.values()[i] = std::max(largest.values()[i], map.values()[i]);
  }
  return pair.mean([&](int y, int x, int) { return double(largest(y, x)); });
}

}  // namespace lightstage::model
