// Balls known by a circle in a picture, with and without a known camera.
#pragma once

#include <vector>

#include "calib/sphere_fit.h"
#include "core/camera_model.h"
#include "core/image.h"

namespace lightstage::calib {

// Pixels; the centre as pixel positions are counted (core/camera_model.h).
struct Circle {
  core::Pixel centre;
  double radius = 0;
};

// In units of the ball's radius: a camera or light so far away sees parallel rays (to 0.01 degrees).
constexpr double kFarInRadii = 1e4;

// Where nothing is known of the camera: one that sees parallel rays, and in which a ball of unit radius at the stage centre fills the circle.
// Throws BadInput unless the circle's radius is positive and all is finite.
core::CameraModel distant_camera(int width, int height, const Circle& circle);

// The ball of this radius whose image is nearest to the circle: the cone through points on it (exact for a ball on the optical axis; elsewhere
// a ball's image is an ellipse, and its outline, by locate_sphere, says more). `sigma_px`, the circle's standard error, becomes
// that of the outline. Throws BadInput for a circle that no ball fills.
Sphere ball_in_circle(const core::CameraModel& camera, const Circle& circle, double radius_m, double sigma_px);

// The circle of a ball seen by parallel rays, found as by locate_sphere (same demands, same errors), with its misfit in `rms_px`.
struct FoundCircle {
  Circle circle;
  double rms_px = 0;
  int points = 0;
};
FoundCircle locate_circle(core::ImageView picture);

// Pixels along the outline of the ball's image, for drawing; empty when it reaches behind the camera.
std::vector<core::Pixel> outline_pixels(const core::CameraModel& camera, const Sphere& ball);

}  // namespace lightstage::calib
