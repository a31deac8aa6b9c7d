#include <algorithm>
#include <array>
#include <cmath>

#include "align/flow.h"
#include "core/error.h"
#include "core/image_file.h"
#include "core/parallel.h"

namespace lightstage::align {

namespace {

// Cubic convolution with a = -1/2, which reproduces quadratics (Keys 1981, "Cubic convolution interpolation for digital image
// processing", eq. 15): weights of the samples at -1, 0, 1, 2 for a place at 0 <= t < 1. At t = 0 they are exactly 0, 1, 0, 0.
// cv::remap is not used since it rounds places to 1/32 pixel and has a = -3/4.
std::array<float, 4> cubic_weights(float t) {
  return {0.5F * t * ((2 - t) * t - 1), 0.5F * (t * t * (3 * t - 5) + 2), 0.5F * t * ((4 - 3 * t) * t + 1),
          0.5F * t * t * (t - 1)};
}

// Four samples of an axis, those beyond its ends repeating the last one.
struct Taps {
  std::array<int, 4> index;
  std::array<float, 4> weight;
};

Taps taps_at(double place, int size) {
  const double whole = std::floor(place);
  Taps taps;
  taps.weight = cubic_weights(static_cast<float>(place - whole));
  for (int k = 0; k < 4; ++k) {
    taps.index[std::size_t(k)] = std::clamp(static_cast<int>(whole) - 1 + k, 0, size - 1);
  }
  return taps;
}

// Pixels are squares about their centres: the picture spans [-0.5, size - 0.5].
bool inside(double place, int size) { return place >= -0.5 && place <= size - 0.5; }

void sample(core::ImageView picture, double x, double y, float* out) {
  const Taps across = taps_at(x, picture.width());
  const Taps down = taps_at(y, picture.height());
  for (int c = 0; c < picture.channels(); ++c) {
    float value = 0;
    float lowest = picture(down.index[1], across.index[1], c);
    float highest = lowest;
    for (std::size_t j = 0; j < 4; ++j) {
      float row = 0;
      for (std::size_t i = 0; i < 4; ++i) {
        const float v = picture(down.index[j], across.index[i], c);
        row += across.weight[i] * v;
        lowest = std::min(lowest, v);
        highest = std::max(highest, v);
      }
      value += down.weight[j] * row;
    }
    out[c] = std::clamp(value, lowest, highest);
  }
}

}  // namespace

core::Image warp(core::ImageView picture, const FlowField& flow) {
  if (flow.channels() != 2 || flow.width() != picture.width() || flow.height() != picture.height()) {
    throw core::BadInput("warp: a flow of " + std::to_string(flow.width()) + " x " + std::to_string(flow.height()) + " x " +
                         std::to_string(flow.channels()) + " does not fit a picture of " +
                         std::to_string(picture.width()) + " x " + std::to_string(picture.height()) + " pixels");
  }
  core::require_finite(flow, "warp: the flow");
  core::require_finite(picture, "warp: the picture");
  constexpr std::size_t kRowsAtATime = 8;
  core::Image result(picture.size());
  core::parallel_for(std::size_t(picture.height()), kRowsAtATime, [&](std::size_t first, std::size_t last) {
    for (int y = int(first); y < int(last); ++y) {
      for (int x = 0; x < picture.width(); ++x) {
        const double from_x = x + double(flow(y, x, 0));
        const double from_y = y + double(flow(y, x, 1));
        if (!inside(from_x, picture.width()) || !inside(from_y, picture.height())) continue;
        sample(picture, from_x, from_y, result.pixel(y, x));
      }
    }
  });
  return result;
}

}  // namespace lightstage::align
