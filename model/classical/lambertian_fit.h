// Albedo and normal of one pixel from its values under many lights, some of which are shadows or highlights.
#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include "core/direction.h"
#include "core/vec3.h"

namespace lightstage::model {

struct LambertianFit {
  core::Vec3 scaled_normal;  // g = albedo * normal; zero where no light shows anything
  double share = 0;  // in [0, 1]: of the lights that face the surface, how many agree with it (sum of weights / number)
  double condition =
      1;  // of the light matrix sqrt(w_i) l_i: largest / smallest singular value, at most kWorstCondition
};

// Photometric stereo (Woodham 1980, "Photometric method for determining surface orientation from multiple images") for a surface that is
// matte but for outliers: v_i = max(0, g.l_i). Iteratively reweighted least squares on the lights that face the surface: first for the
// least sum of absolute errors, which bears highlights and shadows on nearly half of the lights, then with Tukey's weights, which leave them out
// altogether, at a scale from the median absolute error (Holland and Welsch 1977, "Robust regression using iteratively
// reweighted least-squares"). In float64.
//
// What the lights do not determine is as small as possible: one light gives a surface that faces it, lights in a plane a normal in that plane
// (Tikhonov's regularisation, iterated once so that well placed lights are not biased by it).
class LambertianFitter {
 public:
  static constexpr double kWorstCondition = 1e6;

  explicit LambertianFitter(std::span<const core::Direction> lights);

  std::size_t light_count() const { return x_.size(); }

  // One value a light, any finite ones; the weights that the lights were given, in [0, 1], come out in `weights`. Scaling the values scales g alone.
  // At most 45 iterations over the lights.
  LambertianFit operator()(std::span<const float> values, std::span<double> weights) const;

 private:
  struct System;
  System system(std::span<const double> values, std::span<const double> weights) const;
  std::vector<double> x_, y_, z_;
};

}  // namespace lightstage::model
