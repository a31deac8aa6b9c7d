#include "core/display.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "core/parallel.h"

namespace lightstage::core {

namespace {

constexpr float kGamma = static_cast<float>(kDisplayGamma);
constexpr std::size_t kRowsAtATime = 16;

template <class Function>
Image map_values(ImageView image, const Function& function) {
  Image result(image.size());
  const std::size_t row_length = std::size_t(image.width()) * std::size_t(image.channels());
  parallel_for(std::size_t(image.height()), kRowsAtATime, [&](std::size_t first, std::size_t last) {
    for (std::size_t y = first; y < last; ++y) {
      const float* from = image.row(static_cast<int>(y));
      std::transform(from, from + row_length, result.values().data() + y * row_length, function);
    }
  });
  return result;
}

}  // namespace

float srgb_encode(float linear) {
  return linear <= 0.0031308f ? 12.92f * linear : 1.055f * std::pow(linear, 1 / 2.4f) - 0.055f;
}

float srgb_decode(float encoded) {
  return encoded <= 0.04045f ? encoded / 12.92f : std::pow((encoded + 0.055f) / 1.055f, 2.4f);
}

// The order of arguments to max and min lets NaN through: what went wrong before must stay visible.
float display_encode(float linear) {
  return std::pow(std::max(linear, 0.0f), 1 / kGamma);
}

float display_decode(float encoded) {
  return std::min(std::pow(std::max(encoded, 0.0f), kGamma), std::numeric_limits<float>::max());
}

Image display_encode(ImageView linear) {
  return map_values(linear, [](float v) { return display_encode(v); });
}

Image display_decode(ImageView encoded) {
  return map_values(encoded, [](float v) { return display_decode(v); });
}

Image expose(ImageView image, double stops) {
  const double factor = std::exp2(stops);
  return map_values(image, [factor](float v) { return static_cast<float>(v * factor); });
}

}  // namespace lightstage::core
