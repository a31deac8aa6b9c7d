// Round lights of any size, as directions that stand for them.
#pragma once

#include <vector>

#include "core/direction.h"
#include "core/vec3.h"
#include "model/interpolator.h"

namespace lightstage::relight {

// A round light far away, uniform over its disc.
struct AreaLight {
  core::Direction direction;  // to its centre
  double radius_degrees = 0;  // angular, 0 to 180; 0 is a point
  // In all, on a surface that faces it (if it were small), linear RGB in units of pi: {1,1,1} is one stage light.
  core::Vec3 irradiance{1, 1, 1};

  friend bool operator==(const AreaLight&, const AreaLight&) = default;
};

// So many directions, evenly placed on the cap within `radius_degrees` of the axis: equal area, on a Fibonacci spiral
// (Gonzalez 2010) from the axis outwards; one is the axis itself. Throws UsageError for a radius out of range or less than
// one sample.
std::vector<core::Direction> cap_directions(const core::Direction& axis, double radius_degrees, int samples);

// How many directions a light of this radius needs so that no single shadow or highlight of theirs shows in the sum:
// by the picture's height and by the light spacing of the scan (see the definition for the argument). 1 for a radius of
// 0, at most 100000. Throws UsageError for a radius out of range. O(lights^2).
int area_samples(const model::LightInterpolator& interpolator, double radius_degrees);

}  // namespace lightstage::relight
