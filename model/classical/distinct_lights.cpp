#include "model/classical/distinct_lights.h"

#include <algorithm>

#include "core/error.h"

namespace lightstage::model {

namespace {

constexpr double kOnALight = 1e-12;

std::size_t first_within(std::span<const core::Vec3> points, core::Vec3 place, double distance) {
  const auto found = std::find_if(points.begin(), points.end(), [&](core::Vec3 point) {
    const core::Vec3 d = point - place;
    return core::dot(d, d) < distance * distance;
  });
  return std::size_t(found - points.begin());
}

}  // namespace

DistinctLights::DistinctLights(std::span<const core::Direction> lights) {
  if (lights.empty()) throw core::BadInput("interpolation needs at least one light");
  for (const core::Direction& light : lights) {
    const std::size_t point = first_within(points_, light.vec(), kSamePlace);
    point_of_light_.push_back(point);
    if (point == points_.size()) {
      points_.push_back(light.vec());
      lights_at_point_.push_back(0);
    }
    ++lights_at_point_[point];
  }
}

std::vector<double> DistinctLights::one_hot_at(core::Vec3 query) const {
  const std::size_t point = first_within(points_, query, kOnALight);
  if (point == points_.size()) return {};
  std::vector<double> weights(points_.size(), 0.0);
  weights[point] = 1;
  return weights;
}

}  // namespace lightstage::model
