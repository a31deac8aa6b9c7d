// Interpolation by multilevel B-splines, as weights.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <unordered_map>
#include <vector>

#include "core/direction.h"
#include "core/vec3.h"
#include "model/classical/distinct_lights.h"
#include "model/classical/linear_terms.h"
#include "model/interpolator.h"

namespace lightstage::model {

// Lee, Wolberg and Shin 1997, "Scattered data interpolation with multilevel B-splines": a lattice of cubic B-splines is fitted to the values, then one of
// half the cell to what is left, and so on; the interpolant is the sum. Where B_ck is the k-th spline at light c, a lattice's coefficients are (their equations 3 and 5)
//   phi_k = sum_c B_ck^2 (B_ck r_c / S_c) / sum_c B_ck^2,   S_c = sum_k B_ck^2,
// r the rest so far. Masselus et al. 2004 reconstruct reflectance functions with it, a pixel at a time.
//
// It is linear in the values, with lattices that depend on the lights alone: phi = C r, and the rest after a level is r - E C r, with E_ck = B_ck. So the
// interpolant at q is one weight vector over the lights, the same for all pixels:
//   F(q) = p(q)^T f_0 + sum_l e_l(q)^T C_l r_l   =>   v_l = v_(l+1) + C_l^T (e_l(q) - E_l^T v_(l+1)),   w = the same for the polynomial,
// from the finest level (v = 0 beyond it) to the coarsest; e_l(q) are the splines at the query.
//
// Chosen here. The lattice is one in space, over the cube [-1, 1]^3 around the sphere, and the interpolant is its restriction to the sphere. A flat lattice needs a map
// of the sphere, which has a seam, a pole or two charts to blend; the restriction has two continuous derivatives everywhere, for 64 splines at a place instead of 16, which costs nothing
// a pixel. It starts from the least-squares polynomial of first degree instead of 0, so constant and linear functions come out exact and the weights sum to 1.
// Levels run from one cell to where no two lights share a spline; there the interpolant is exact at the lights. The axes are those of the stage: turning all lights changes the
// weights slightly.
class BSplineWeights {
 public:
  // Throws BadInput for no lights. O(64 n) a level, about log2(16 / smallest distance between lights) levels.
  explicit BSplineWeights(std::span<const core::Direction> lights);

  // One weight a light. O(64 n levels): 0.2 ms for 302.
  std::vector<double> operator()(const core::Direction& query) const;

  // sum_q irradiance_q w_i(q). w is linear in the splines at the query, so these are summed first: O(64 levels) a light.
  std::vector<core::Vec3> sum(std::span<const DistantLight> lights) const;

 private:
  static constexpr std::size_t kSplines = 64;  // that are not 0 at a place
  using Splines = std::array<double, kSplines>;
  using Keys = std::array<std::uint64_t, kSplines>;  // the splines' places in the lattice

  struct Level {
    int cells;                                               // along an edge of the cube
    std::unordered_map<std::uint64_t, std::uint32_t> index;  // of the splines that some light is under
    std::vector<std::array<std::uint32_t, kSplines>> splines_of_point;
    std::vector<Splines> values;           // E, by point
    std::vector<Splines> coefficient_per;  // C, by point
  };
  // Of the queries' splines, of one level or the polynomial.
  template <class Value>
  using Summed = std::vector<std::vector<Value>>;

  static void splines_at(core::Vec3 place, int cells, Keys& keys, Splines& values);
  Level level(int cells) const;
  template <class Value>
  std::vector<Value> weights(const std::vector<Value>& polynomial, Summed<Value> splines) const;

  DistinctLights lights_;
  LinearTerms polynomial_;
  std::vector<std::vector<double>> polynomial_at_points_;  // P
  std::vector<std::vector<double>> polynomial_fit_;        // (P^T P)^-1 P^T, by term
  std::vector<Level> levels_;                              // coarse to fine
};

}  // namespace lightstage::model
