// How noisy a picture is, from the picture.
#pragma once

#include "core/image.h"

namespace lightstage::calib {

// Second difference in both directions at an inner pixel of a picture of one channel, scaled so that its standard deviation is that of the
// noise of a pixel; blind to planes and straight edges along the axes (Immerkaer 1996, "Fast noise variance estimation").
inline double noise_response(core::ImageView v, int y, int x) {
  const auto second = [&](int row) { return double(v(row, x - 1)) - 2.0 * double(v(row, x)) + double(v(row, x + 1)); };
  return (second(y - 1) - 2 * second(y) + second(y + 1)) / 6;
}

}  // namespace lightstage::calib
