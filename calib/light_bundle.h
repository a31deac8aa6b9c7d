// Positions of near lights from their highlights on several balls or in several cameras, by bundle adjustment.
#pragma once

#include <map>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "calib/sphere_fit.h"
#include "core/camera_model.h"
#include "core/vec3.h"

namespace lightstage::calib {

// Where the camera sees a light at `light_position` (stage frame, metres) reflected in the ball: the point between the two at which the angles
// are equal (Alhazen's problem, by bisection to the last digit), projected with the lens's distortion. Nothing when camera or light are inside
// the ball, or the point is behind the camera. Inverse of reflect_at (calib/mirror_ball.h).
std::optional<core::Pixel> predict_highlight(const core::CameraModel& camera, const Sphere& ball,
                                             core::Vec3 light_position);

struct HighlightSeen {
  int light_index = 0;
  std::size_t camera = 0, ball = 0;  // into BundleInput
  core::Pixel position;
  double sigma_px = 0;  // of each coordinate
  std::string where;    // what reasons call it; "camera 0, ball 1" when empty
};

// A ball as one camera alone sees it (locate_sphere).
struct OutlineSeen {
  std::size_t camera = 0, ball = 0;
  Sphere sphere;
};

// What is known beforehand of a light's distance from stage centre.
struct LightDistance {
  double metres = 0;
  double sigma_m = 0;
};

struct BundleInput {
  std::vector<core::CameraModel> cameras;  // taken as exact
  std::vector<OutlineSeen> outlines;       // at least one a ball; a ball's radius is exact
  std::vector<HighlightSeen> highlights;
  std::map<int, LightDistance> distances;  // by light index; those that are not named are not known
};

struct BundledLight {
  int light_index = 0;
  bool placed = false;
  core::Vec3 position;       // metres, stage frame
  core::Mat3 covariance;     // of the position, square metres; where the balls may be is in it
  double sigma_degrees = 0;  // of the direction from stage centre, both coordinates together
  double sigma_m = 0;        // of the position, all coordinates together
  double rms_px = 0;         // of what the fit leaves, per coordinate
  int highlights = 0;        // that count
  std::string reason;        // why it was not placed, or which highlights were left out
};

struct BundleResult {
  std::vector<BundledLight> lights;  // by index; every light that has a highlight
  std::vector<Sphere> balls;
  double rms_px = 0;       // over all highlights that count, per coordinate
  double error_scale = 1;  // true standard errors of highlights over those given, as their residuals show
};

// Least squares over all lights' positions and all balls' centres of what is seen in the pictures: highlights against predict_highlight,
// outlines against each ball's cone of tangent rays, each over its standard error, and distances where given (Ceres Solver;
// Levenberg-Marquardt, sparse Schur complement). First with a Cauchy loss; then highlights further off than five standard errors are left
// out (lights seen more than twice) or the light is not placed, and the rest solved again without it. Where at least 10 of the highlights' coordinates
// are redundant, their standard errors are then raised, never lowered, to what their residuals show (variance component estimation, Foerstner 1979), and all is
// solved again. Covariances by inversion of the
// normal equations at the solution. Lights seen once need a distance, and are not placed without. The same for every
// thread count. Cost: about 2 ms a light and highlight. Throws BadInput for indices out of range, errors that are not positive, or a ball
// without an outline.
BundleResult bundle_lights(const BundleInput& input);

}  // namespace lightstage::calib
