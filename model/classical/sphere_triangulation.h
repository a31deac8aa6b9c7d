// Delaunay triangulation of points on the sphere.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "core/vec3.h"

namespace lightstage::model {

// Three points, anticlockwise seen from outside the sphere, and the cap through them: no point lies inside it.
struct SphereTriangle {
  std::array<std::size_t, 3> corners{};
  core::Vec3 cap_centre;  // unit vector
  double cap_radius =
      0;  // radians, under pi; over pi/2 where all points are in one hemisphere and this is its open side
};

// The triangles are the faces of the points' convex hull: a plane that has all other points on one side cuts an empty cap out of the sphere,
// which is Delaunay's condition there (Brown 1979, "Voronoi diagrams from convex hulls"). Points are added one at a time to a hull that
// exists already. Whether a point is outside a face is decided exactly, on coordinates rounded to 2^-40 (1e-12 radians): in double precision first and, where that could be
// wrong, in 128-bit integers. So four points on one circle (the rows of a dome) give two triangles in one plane, consistently, never a hole or an overlap.
class SphereTriangulation {
 public:
  // Of at least one unit vector, no two closer than 1e-5 (so that rounding cannot bury one under others). Where the points do not span
  // space (fewer than four of them, all on one circle), points far from all others are put in until they do.
  explicit SphereTriangulation(std::span<const core::Vec3> points);

  // A unit vector at least 1e-5 away from all points. O(triangles).
  void add(core::Vec3 point);

  // Those given first, in their order, then any put in, then those added.
  const std::vector<core::Vec3>& points() const { return points_; }
  const std::vector<SphereTriangle>& triangles() const { return triangles_; }

 private:
  struct Lattice {
    std::int64_t x, y, z;  // of 2^-40
  };
  void append(core::Vec3 point);
  std::array<std::size_t, 4> span_space();
  SphereTriangle triangle(std::size_t a, std::size_t b, std::size_t c) const;
  bool is_outside(const SphereTriangle& face, std::size_t point) const;
  int side(std::size_t a, std::size_t b, std::size_t c, std::size_t d) const;
  void enlarge_by(std::size_t point);

  std::vector<core::Vec3> points_;
  std::vector<Lattice> exact_;
  std::vector<SphereTriangle> triangles_;
};

}  // namespace lightstage::model
