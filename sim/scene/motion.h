// How the subject moves: a slow drift and sway, smooth in time.
#pragma once

#include <cstdint>

#include "core/clock.h"
#include "core/vec3.h"
#include "sim/simulation.h"

namespace lightstage::sim {

class Motion {
 public:
  // About where the subject stands.
  Motion(const MotionSpec& spec, const SubjectSpec& subject, std::uint64_t seed);

  // The pose at time t. The drift from the rest pose is never longer than the amplitude, the rotation from it
  // never larger than rotation_degrees; the rest pose exactly where both are 0.
  core::RigidTransform stage_from_subject(core::Nanoseconds t) const;
  // Without any motion: yaw and place alone.
  core::RigidTransform rest() const { return rest_; }

 private:
  core::Vec3 wander(double seconds, std::uint64_t stream) const;

  MotionSpec spec_;
  std::uint64_t seed_;
  core::RigidTransform rest_;
};

}  // namespace lightstage::sim
