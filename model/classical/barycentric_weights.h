// Barycentric interpolation over the triangles between the lights, as weights.
#pragma once

#include <array>
#include <cstddef>
#include <span>
#include <vector>

#include "core/direction.h"
#include "core/vec3.h"
#include "model/classical/distinct_lights.h"
#include "model/classical/sphere_triangulation.h"
#include "model/interpolator.h"

namespace lightstage::model {

// The query's weights over the three corners of its spherical Delaunay triangle are those of the point where its ray meets the triangle's plane
// (gnomonic projection): w_i = det(q, l_j, l_k) / sum. Of the known coordinates on spherical triangles these alone are non-negative, sum to 1, and are
// cheap: areas of spherical triangles need inverse trigonometry and lose their digits in slivers; the coordinates of Alfeld, Neamtu and Schumaker 1996
// ("Bernstein-Bezier polynomials on spheres and sphere-like surfaces"), w_i = det(q, l_j, l_k) / det(l_i, l_j, l_k), do not sum to 1. On an edge the weights
// are the same from both sides (the third one is 0), so they are continuous; at a light they are 1. sum_i w_i l_i has the direction of q and a length of
// at least cos r, r the radius of the triangle's cap: functions linear in xyz come out right but for that factor, so to the second order of the spacing.
//
// Holes. A triangle whose cap is wider than three spacings (the median over the lights of the angle to the second nearest), or than 75 degrees, is one: the
// open bottom of a stage, the far side of a dome, either side of a ring, and all of the sphere around fewer than four lights. Points are put into holes, the widest
// cap's centre first, with gaps that grow with the distance from the lights, until no cap is too wide; the value of each is the mean of its neighbours', by
// the inverse of their angles, solved for all at once: a soap film over the hole's rim, so its value stays between those of the rim. Each is hence a
// fixed weighted mean of the lights, and the sphere is triangulated all over with caps under 75 degrees: weights are continuous, non-negative and sum to 1 everywhere.
// Triangles with caps under 1.5 spacings are never touched.
class BarycentricWeights {
 public:
  // Throws BadInput for no lights. O(n^2), 5 ms for 331; and O(h^3) for h points in holes, at most a few hundred.
  explicit BarycentricWeights(std::span<const core::Direction> lights);

  // One weight a light. O(n): 4 us for 331.
  std::vector<double> operator()(const core::Direction& query) const;

  // Of many queries, their weights times their irradiances, one sum a light. Each query's triangle is searched from that of the one before, across
  // the edges beyond which the query lies: some steps where lights come in the order of a map's pixels, O(sqrt(n)) anywhere. The same for every
  // thread count; to rounding the sum over operator().
  std::vector<core::Vec3> sum(std::span<const DistantLight> queries) const;

 private:
  struct Triangle {
    std::array<std::size_t, 3> corners;       // of the triangulation's points
    std::array<core::Vec3, 3> coordinate_of;  // w_i before they are divided by their sum: dot(coordinate_of[i], q)
    std::array<std::size_t, 3> beyond{};      // the triangle on the other side of the edge opposite corner i
  };
  struct Place {
    std::size_t triangle = 0;
    std::array<double, 3> weights{};  // of its corners
  };
  // The triangle in which the smallest coordinate is largest: rounding can leave a query on an edge outside both triangles, never without one.
  Place place_of(core::Vec3 query) const;
  Place place_near(std::size_t triangle, core::Vec3 query) const;
  void link_triangles();
  void fill_holes(SphereTriangulation& triangulation) const;
  void solve_holes(const SphereTriangulation& triangulation);

  DistinctLights lights_;
  std::vector<Triangle> triangles_;
  std::vector<std::vector<double>> hole_weights_;  // over the distinct lights, of each point in a hole
};

}  // namespace lightstage::model
