// Sizes of light and of errors.
#pragma once

#include <cmath>

#include "core/vec3.h"

namespace lightstage::relight {

inline double square(double v) {
  return v * v;
}

// Of light that may be negative: the mean of its channels' absolute values.
inline double magnitude(core::Vec3 light) {
  return (std::abs(light.x) + std::abs(light.y) + std::abs(light.z)) / 3;
}

}  // namespace lightstage::relight
