#include "sim/scene/motion.h"

#include <numbers>

#include "core/direction.h"
#include "sim/scene/random.h"

namespace lightstage::sim {
namespace {

// One slow and one less slow sine with seeded periods and phases; at most 1 in size.
double wave(double seconds, std::uint64_t seed) {
  constexpr double kTwoPi = 2 * std::numbers::pi;
  const double slow_period = 6 + 3 * uniform(seed, 0);
  const double fast_period = 2.5 + 1.5 * uniform(seed, 1);
  return 0.8 * std::sin(kTwoPi * (seconds / slow_period + uniform(seed, 2))) +
         0.2 * std::sin(kTwoPi * (seconds / fast_period + uniform(seed, 3)));
}

}  // namespace

Motion::Motion(const MotionSpec& spec, const SubjectSpec& subject, std::uint64_t seed) : spec_(spec), seed_(seed) {
  if (subject.yaw_degrees != 0) {
    rest_.rotation = core::rotation_about({0, 1, 0}, core::radians_from_degrees(subject.yaw_degrees));
  }
  rest_.translation = subject.position;
}

// A vector in the unit ball: mostly sideways, least towards the camera, as a standing person sways.
core::Vec3 Motion::wander(double seconds, std::uint64_t stream) const {
  const std::uint64_t seed = mix(seed_, stream);
  return {0.76 * wave(seconds, mix(seed, 0)), 0.52 * wave(seconds, mix(seed, 1)), 0.39 * wave(seconds, mix(seed, 2))};
}

core::RigidTransform Motion::stage_from_subject(core::Nanoseconds t) const {
  const double seconds = double(t) / double(core::kSecond);
  core::RigidTransform pose = rest_;
  if (spec_.rotation_degrees != 0) {
    // Turning the head about y is the largest part: x and y of the wandering change places.
    const core::Vec3 w = wander(seconds, 2);
    const core::Vec3 rotation = core::Vec3{w.y, w.x, w.z} * core::radians_from_degrees(spec_.rotation_degrees);
    const double angle = core::norm(rotation);
    if (angle > 0) pose.rotation = core::rotation_about(rotation, angle) * pose.rotation;
  }
  if (spec_.amplitude_m != 0) pose.translation = rest_.translation + wander(seconds, 1) * spec_.amplitude_m;
  return pose;
}

}  // namespace lightstage::sim
