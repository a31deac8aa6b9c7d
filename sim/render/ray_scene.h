// Triangles that rays can be shot at: Embree 3, with its handles owned.
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>

#include "sim/render/vec3f.h"

namespace lightstage::sim {

using Triangle = std::array<std::uint32_t, 3>;

// The hit point is (1 - u - v) p0 + u p1 + v p2 of the triangle's corners.
struct RayHit {
  std::uint32_t triangle = 0;
  float u = 0, v = 0;
};

// Immutable once built; rays may be shot from several threads. The hierarchy is built by one thread, so it is
// the same every time.
class RayScene {
 public:
  // Indices must be in range. Throws core::Error when Embree cannot build it.
  RayScene(std::span<const Vec3f> vertices, std::span<const Triangle> triangles);
  ~RayScene();
  RayScene(RayScene&&) noexcept;
  RayScene& operator=(RayScene&&) noexcept;

  // The nearest triangle, seen from either side.
  std::optional<RayHit> first_hit(Vec3f origin, Vec3f unit_direction) const;
  // True when anything lies between the two points.
  bool blocked(Vec3f from, Vec3f to) const;

 private:
  struct Handles;
  std::unique_ptr<Handles> handles_;
};

}  // namespace lightstage::sim
