// Thin-plate interpolation over points in space, as weights.
#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include "core/direction.h"
#include "core/vec3.h"
#include "model/classical/distinct_lights.h"
#include "model/interpolator.h"

namespace lightstage::model {

// The interpolant of values f_j at the lights' xyz is
//   F(q) = sum_j c_j phi(|q - l_j|) + sum_m d_m p_m(q),   phi(r) = r^2 log r,   p = 1 and the linear terms,
// with sum_j c_j p_m(l_j) = 0. It is linear in the values, so F(q) = sum_j w_j(q) f_j with weights that
// depend on the geometry alone: M [w; v] = [phi(|q - l_j|); p(q)], M = [A P; P^T 0] (Wendland 2004,
// "Scattered Data Approximation", sections 8.4 and 8.5: phi is conditionally positive definite of order 2 in
// every dimension, so M is regular for distinct lights). M is inverted once; a query costs n^2
// multiplications. Since 1 is among the p, the weights sum to 1; at a light they are 1 there and 0 elsewhere.
//
// Lights in the same place share their weight (DistinctLights). Axes along which the lights spread less than 1 % of the widest get no linear term: one light
// leaves the constant, lights in one plane a plane, where a full polynomial would not be determined or would
// follow calibration errors.
class ThinPlateWeights {
 public:
  // Throws BadInput for no lights, UsageError for more than 8000 (the matrix would take over 512 MB). O(n^3),
  // 5 ms for 331.
  explicit ThinPlateWeights(std::span<const core::Direction> lights);

  // One weight a light.
  std::vector<double> operator()(const core::Direction& query) const;

  // sum_q irradiance_q w_i(q). Because w is linear in the right side, the right sides of all lights are summed first and M is applied
  // once: O(n) a light. Equal to the sum of single queries to rounding.
  std::vector<core::Vec3> sum(std::span<const DistantLight> lights) const;

 private:
  void choose_polynomial();
  void invert();
  std::vector<double> right_side(core::Vec3 query) const;
  template <class Value>
  std::vector<Value> solve(const std::vector<Value>& right_side) const;

  DistinctLights lights_;
  core::Vec3 centre_;  // the polynomial is 1, axis_k . (q - centre)
  std::vector<core::Vec3> axes_;
  std::vector<double> inverse_;  // of M, the part that gives w: a column a term of the right side
};

}  // namespace lightstage::model
