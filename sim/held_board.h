// How somebody holds a calibration board before the cameras: one pose after another.
#pragma once

#include <cstdint>

#include "core/vec3.h"

namespace lightstage::sim {

// Pose number `instant` of a board about stage centre: its middle within `reach_m` of it on each axis, its front (+z of the board's middle
// frame, x right, y up) towards +z, tilted by 12 to 40 degrees about an axis that goes round from pose to pose, and turned by up to 20 degrees in its
// own plane. A function of seed and number alone.
core::RigidTransform held_board_pose(std::uint64_t seed, int instant, double reach_m);

}  // namespace lightstage::sim
