// The polynomial that scattered data on the sphere determine.
#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include "core/vec3.h"

namespace lightstage::model {

// 1 and the linear terms along the axes in which the points spread, about their centre. Axes along which they spread less than 1 % of the
// widest get no term: one point leaves the constant, points in one plane a plane, where a full polynomial would not be determined or would
// follow calibration errors.
class LinearTerms {
 public:
  // Of at least one point.
  explicit LinearTerms(std::span<const core::Vec3> points);

  std::size_t count() const { return 1 + axes_.size(); }
  std::vector<double> at(core::Vec3 place) const;

 private:
  core::Vec3 centre_;
  std::vector<core::Vec3> axes_;
};

}  // namespace lightstage::model
