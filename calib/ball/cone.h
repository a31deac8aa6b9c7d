// The cone of viewing rays that touch a ball, in the camera frame.
#pragma once

#include <optional>
#include <span>
#include <vector>

#include "calib/sphere_fit.h"
#include "core/camera_model.h"
#include "core/vec3.h"

namespace lightstage::calib {

struct Cone {
  core::Vec3 axis;        // unit, from the camera towards the ball's centre, camera frame
  double half_angle = 0;  // radians
};

// Throws BadInput when the camera is inside the ball or the ball's centre is not in front of it.
Cone cone_around(const core::CameraModel& camera, const Sphere& ball);
// The centre of the ball of this radius that fills the cone, stage frame.
core::Vec3 ball_centre(const core::CameraModel& camera, const Cone& cone, double radius_m);

// The pixel of the ray at `angle` from the cone's axis on the side `azimuth`, both in radians; nothing behind
// the camera. Azimuth runs about the axis from an arbitrary but fixed side.
std::optional<core::Pixel> pixel_on_cone(const core::CameraModel& camera, const Cone& cone, double azimuth,
                                         double angle);
core::Vec3 ray_on_cone(const Cone& cone, double azimuth, double angle);

// Radius of the ball's image in pixels (the mean over the outline).
double outline_radius_px(const core::CameraModel& camera, const Cone& cone);

// Standard errors in pixels of a ball's image: of its centre each way, and of its radius. 0 for a ball that was not measured (no outline
// points), which is taken as exact.
struct OutlineSigma {
  double centre_px = 0, radius_px = 0;
};
OutlineSigma outline_sigma(const Sphere& ball);

// A unit ray that touches the ball, and how many pixels an angle of one radian measures there.
struct TangentRay {
  core::Vec3 ray;
  double px_per_radian = 0;
};

struct ConeFit {
  Cone cone;
  double rms_px = 0;  // of the rays that agree
  int agreeing = 0;   // rays within three robust standard deviations
};

// The cone that most rays lie on: the best of many through three rays each (drawn from a fixed seed), those
// agreeing that lie within `tolerance_px`. Outliers may be the majority. Nothing for fewer than three rays or
// when all lie in one plane.
std::optional<Cone> consensus_cone(std::span<const TangentRay> rays, double tolerance_px);

// Least squares from `start`, iteratively reweighted with Tukey's biweight. Nothing when the rays do not
// determine a cone.
std::optional<ConeFit> fit_cone(std::span<const TangentRay> rays, const Cone& start);

}  // namespace lightstage::calib
