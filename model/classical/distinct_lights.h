// The places of a stage's lights, each once.
#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include "core/direction.h"
#include "core/vec3.h"

namespace lightstage::model {

// Lights closer together than this many radians (finer than any calibration) stand in one place.
inline constexpr double kSamePlace = 1e-4;

// Lights in one place are one point and share its weight equally: an interpolant can have but one value there.
class DistinctLights {
 public:
  // Throws BadInput for no lights. O(n points).
  explicit DistinctLights(std::span<const core::Direction> lights);

  const std::vector<core::Vec3>& points() const { return points_; }
  std::size_t lights_at(std::size_t point) const { return lights_at_point_[point]; }

  // The weights of the lights from those of the points.
  template <class Value>
  std::vector<Value> per_light(const std::vector<Value>& per_point) const {
    std::vector<Value> result;
    result.reserve(point_of_light_.size());
    for (const std::size_t point : point_of_light_)
      result.push_back(per_point[point] / double(lights_at_point_[point]));
    return result;
  }

  // Weight 1 at the point on which the query stands to rounding (1e-12 radians), 0 elsewhere: interpolants that are exact there say so
  // without rounding. Empty where it stands on none.
  std::vector<double> one_hot_at(core::Vec3 query) const;

 private:
  std::vector<core::Vec3> points_;
  std::vector<std::size_t> point_of_light_;
  std::vector<std::size_t> lights_at_point_;
};

}  // namespace lightstage::model
