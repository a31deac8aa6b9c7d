#include "sim/scene/true_lights.h"

#include "core/error.h"
#include "sim/scene/random.h"

namespace lightstage::sim {
namespace {

core::Vec3 disturbed(core::Vec3 position, double first_angle, double second_angle) {
  const double distance = core::norm(position);
  const core::Vec3 axis = position / distance;
  // The coordinate axis least along the light's gives the first tangent without loss.
  const double ax = std::abs(axis.x), ay = std::abs(axis.y), az = std::abs(axis.z);
  const core::Vec3 least = ax <= ay && ax <= az ? core::Vec3{1, 0, 0}
                           : ay <= az           ? core::Vec3{0, 1, 0}
                                                : core::Vec3{0, 0, 1};
  const core::Vec3 across = core::cross(axis, least);
  const core::Vec3 first = across / core::norm(across);
  const core::Vec3 second = core::cross(axis, first);
  const core::Vec3 offset = first * first_angle + second * second_angle;
  const double angle = core::norm(offset);
  if (angle == 0) return position;
  return (axis * std::cos(angle) + offset * (std::sin(angle) / angle)) * distance;
}

}  // namespace

std::vector<core::Light> true_lights(const capture::Stage& stage) {
  const capture::StageSimulation& how = stage.simulation;
  std::vector<core::Light> lights;
  lights.reserve(stage.light_positions.size());
  for (std::size_t i = 0; i < stage.light_positions.size(); ++i) {
    if (core::norm(stage.light_positions[i]) == 0) {
      throw core::BadInput("stage '" + stage.name + "': light " + std::to_string(i) + " is at stage centre; move it");
    }
    const std::uint64_t seed = mix(how.seed, i);
    const double sigma = core::radians_from_degrees(how.mount_error_degrees);
    core::Light light;
    light.position = disturbed(stage.light_positions[i], sigma * normal(seed, 0), sigma * normal(seed, 1));
    light.direction = core::Direction::from_vector(*light.position);
    const double common = std::sqrt(0.75) * normal(seed, 2);
    for (std::size_t c = 0; c < 3; ++c)
      light.gain[c] = std::exp(how.gain_spread * (common + 0.5 * normal(seed, 3 + c)));
    lights.push_back(light);
  }
  for (const int dead : how.dead_lights) {
    if (dead < 0 || std::size_t(dead) >= lights.size()) {
      throw core::BadInput("stage '" + stage.name + "': dead light " + std::to_string(dead) +
                           " does not exist; there are " + std::to_string(lights.size()) + " lights");
    }
    lights[std::size_t(dead)].gain = {0, 0, 0};
  }
  return lights;
}

}  // namespace lightstage::sim
