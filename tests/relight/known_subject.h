// A subject whose picture under any light is known, for methods that have no linear weights.
#pragma once

#include <algorithm>
#include <atomic>
#include <cmath>

#include "core/sphere.h"
#include "model/interpolator.h"
#include "model/synthetic_scan.h"

namespace lightstage::test {

// A ball that fills the picture, seen from +z: matt, with a highlight a few degrees wide, and half of it shadowed by a wall unless the light comes over it.
inline PixelFunction shiny_ball(core::ImageSize size) {
  return [size](const core::Direction& light, int y, int x, int c) {
    const double px = (2.0 * x + 1 - size.width) / size.width;
    const double py = (size.height - 2.0 * y - 1) / size.height;
    const double r2 = px * px + py * py;
    if (r2 >= 1) return 0.0;
    const core::Vec3 normal{px, py, std::sqrt(1 - r2)};
    const core::Vec3 mirrored = 2 * normal.z * normal - core::Vec3{0, 0, 1};  // of the view
    const double matt = std::max(0.0, core::dot(normal, light.vec()));
    const double gloss = std::pow(std::max(0.0, core::dot(mirrored, light.vec())), 60);
    const double lit = 1 / (1 + std::exp(-25 * (light.y() - 0.6 * py)));
    return (0.3 + 0.7 * lit) * (0.8 - 0.2 * c) * matt + 0.6 * gloss;
  };
}

class KnownSubject : public model::LightInterpolator {
 public:
  KnownSubject(std::size_t lights, core::ImageSize size, PixelFunction value)
      : size_(size), value_(value), scan_(scan_of(core::fibonacci_directions(lights), size, value)) {}
  std::string_view name() const override { return "known"; }
  const core::OlatScan& scan() const override { return scan_; }
  core::Image render(const core::Direction& query) const override {
    ++rendered;
    return picture_of(size_, query, value_);
  }
  mutable std::atomic<int> rendered = 0;

 private:
  core::ImageSize size_;
  PixelFunction value_;
  core::OlatScan scan_;
};

}  // namespace lightstage::test
