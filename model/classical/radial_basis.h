// Interpolation by radial basis functions over points in space, as weights.
#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include "core/direction.h"
#include "core/vec3.h"
#include "model/classical/distinct_lights.h"
#include "model/classical/linear_terms.h"
#include "model/interpolator.h"
#include "model/methods.h"

namespace lightstage::model {

// The interpolant of values f_j at the lights' xyz is
//   F(q) = sum_j c_j phi(|q - l_j|) + sum_m d_m p_m(q),   phi(r) = r^2 log r or -r,   p = 1 and the linear terms,
// with sum_j c_j p_m(l_j) = 0. It is linear in the values, so F(q) = sum_j w_j(q) f_j with weights that
// depend on the geometry alone: M [w; v] = [phi(|q - l_j|); p(q)], M = [A P; P^T 0] (Wendland 2004,
// "Scattered Data Approximation", sections 8.4 and 8.5: phi is conditionally positive definite of order 2 or 1 in
// every dimension, so M is regular for distinct lights). M is inverted once; a query costs n^2
// multiplications. Since 1 is among the p, the weights sum to 1; at a light they are 1 there and 0 elsewhere.
//
// Smoothing adds a ridge to the kernel matrix, A + smoothing tau D^-1 (Wahba 1990, "Spline Models for Observational Data", section 2.4): F then comes
// no longer through the values but minimises sum_j n_j (f_j - F(l_j))^2 + smoothing tau |F|^2, n_j lights in one place. tau is the trace of A on the
// coefficients that the side conditions leave, which is the sum of its eigenvalues there. It grows with the number of lights and with the kernel's scale as the first term
// does, so a value means the same on every stage; 1 damps even the smoothest component that is not linear to half, and values towards infinity leave
// the least-squares polynomial.
//
// Lights in the same place share their weight (DistinctLights); the linear terms are those that the lights determine (LinearTerms).
class RadialBasisWeights {
 public:
  // Throws BadInput for no lights, UsageError for more than 8000 (the matrix would take over 512 MB) or a smoothing that is not finite and >= 0.
  // O(n^3), 5 ms for 331.
  explicit RadialBasisWeights(std::span<const core::Direction> lights, const RadialBasis& basis = {});

  // One weight a light.
  std::vector<double> operator()(const core::Direction& query) const;

  // sum_q irradiance_q w_i(q). Because w is linear in the right side, the right sides of all lights are summed first and M is applied
  // once: O(n) a light. Equal to the sum of single queries to rounding.
  std::vector<core::Vec3> sum(std::span<const DistantLight> lights) const;

 private:
  void invert();
  double kernel(double squared_distance) const;
  std::vector<double> right_side(core::Vec3 query) const;
  template <class Value>
  std::vector<Value> solve(const std::vector<Value>& right_side) const;

  RadialBasis basis_;
  DistinctLights lights_;
  LinearTerms polynomial_;
  std::vector<double> inverse_;  // of M, the part that gives w: a column a term of the right side
};

}  // namespace lightstage::model
