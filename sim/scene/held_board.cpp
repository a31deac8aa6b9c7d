#include "sim/held_board.h"

#include <cmath>
#include <numbers>

#include "core/direction.h"
#include "sim/scene/random.h"

namespace lightstage::sim {

core::RigidTransform held_board_pose(std::uint64_t seed, int instant, double reach_m) {
  const std::uint64_t stream = mix(mix(seed, 0xb0a2d), std::uint64_t(instant));
  const auto signed_uniform = [&](std::uint64_t n) { return 2 * uniform(stream, n) - 1; };
  // Successive axes a golden angle apart lie evenly about the circle however many there are.
  const double azimuth = instant * std::numbers::pi * (3 - std::sqrt(5.0)) + 0.3 * signed_uniform(0);
  const double tilt = core::radians_from_degrees(12 + 28 * uniform(stream, 1));
  const double roll = core::radians_from_degrees(20 * signed_uniform(2));
  core::RigidTransform pose;
  pose.rotation =
      core::rotation_about({std::cos(azimuth), std::sin(azimuth), 0}, tilt) * core::rotation_about({0, 0, 1}, roll);
  pose.translation = core::Vec3{signed_uniform(3), signed_uniform(4), signed_uniform(5)} * reach_m;
  return pose;
}

}  // namespace lightstage::sim
