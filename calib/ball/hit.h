// Where a viewing ray meets a ball.
#pragma once

#include <optional>
#include <string>

#include "calib/sphere_fit.h"
#include "core/camera_model.h"
#include "core/vec3.h"

namespace lightstage::calib {

struct BallHit {
  core::Vec3 view;    // unit, the ray
  core::Vec3 normal;  // unit, outwards
  double miss = 0;    // distance of the ray from the ball's centre over the radius, 0 to 1
};

// All in the stage frame. Nothing when the ray of `pixel` misses the ball.
std::optional<BallHit> hit_ball(const core::CameraModel& camera, const Sphere& ball, core::Pixel pixel);

// Throws BadInput, saying what the picture is, unless it has the camera's size and finite values.
void require_picture_of(core::ImageView picture, const core::CameraModel& camera, const std::string& what);

}  // namespace lightstage::calib
