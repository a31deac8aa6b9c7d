// Scans whose pictures are known functions of the light, for tests.
#pragma once

#include <functional>
#include <utility>
#include <vector>

#include "core/olat_scan.h"

namespace lightstage::test {

// The value of a pixel under a light.
using PixelFunction = std::function<double(const core::Direction& light, int y, int x, int c)>;

inline core::Image picture_of(core::ImageSize size, const core::Direction& light,
                              const PixelFunction& value) {
  core::Image image(size);
  for (int y = 0; y < size.height; ++y)
    for (int x = 0; x < size.width; ++x)
      for (int c = 0; c < size.channels; ++c) image(y, x, c) = static_cast<float>(value(light, y, x, c));
  return image;
}

inline core::OlatScan scan_of(const std::vector<core::Direction>& directions, core::ImageSize size,
                              const PixelFunction& value, core::Image mask = {}) {
  std::vector<core::Light> lights;
  for (const core::Direction& d : directions) lights.push_back({d, {}, {1, 1, 1}});
  auto load = [directions, size, value](std::size_t i) { return picture_of(size, directions[i], value); };
  return core::OlatScan("synthetic", std::move(lights), size, std::move(mask), load);
}

// A matt ball that fills the picture, seen from +z, with a colour of its own a channel; black around it.
inline PixelFunction matt_ball(core::ImageSize size) {
  return [size](const core::Direction& light, int y, int x, int c) {
    const double px = (2.0 * x + 1 - size.width) / size.width;
    const double py = (size.height - 2.0 * y - 1) / size.height;
    const double r2 = px * px + py * py;
    if (r2 >= 1) return 0.0;
    const double cosine = px * light.x() + py * light.y() + std::sqrt(1 - r2) * light.z();
    return (0.9 - 0.25 * c) * std::max(0.0, cosine);
  };
}

}  // namespace lightstage::test
