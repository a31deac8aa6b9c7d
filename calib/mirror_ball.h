// Light directions from highlights on a mirror ball.
#pragma once

#include <optional>
#include <span>
#include <string>
#include <vector>

#include "calib/sphere_fit.h"
#include "core/camera_model.h"
#include "core/direction.h"
#include "core/image.h"

namespace lightstage::calib {

struct Highlight {
  core::Pixel position;    // sub-pixel
  double peak = 0;         // brightest value, linear
  double sigma_px = 0;     // standard error of the position
  bool clipped = false;    // the peak is at the sensor's limit
};

// The brightest compact spot on the ball: intensity-weighted centroid over the connected pixels that stand above the ball's own
// background, refined until it no longer moves. A second, dimmer spot (inter-reflection) is ignored. Nothing when no spot stands
// out of the noise. `saturation` is the value at which the sensor clips (0: unknown).
std::optional<Highlight> find_highlight(core::ImageView picture, const core::CameraModel& camera, const Sphere& ball,
                                        double saturation = 0);

// The mirror reflection of the viewing ray through `pixel` on the ball: where it leaves the surface and in which direction
// (the reflected direction, not the normal), stage frame. Nothing when the ray misses the ball.
struct ReflectedRay {
  core::Vec3 origin;
  core::Vec3 direction;  // unit
};
std::optional<ReflectedRay> reflect_at(const core::CameraModel& camera, const Sphere& ball, core::Pixel pixel);

// A direction less certain than this says no more than the stage's drawing.
constexpr double kLargestSigmaDegrees = 1;

struct LightEstimate {
  int light_index = 0;
  bool placed = false;
  core::Direction direction;   // from stage centre
  core::Vec3 position;         // metres, on the stage's sphere
  double sigma_degrees = 0;    // standard error from highlight and outline; 180 where the rim is within it
  std::string reason;          // why it was not placed
};

// One picture of the ball lit by one light, free of ambient light.
struct BallPicture {
  int light_index = 0;
  core::Image image;
  double saturation = 0;
};

// Follows the reflected ray to the sphere of radius `stage_radius_m` about the stage centre, since a light at finite distance lies in
// another direction from the ball's surface than from the centre. Lights without a highlight (dead, behind the ball) are not placed.
LightEstimate estimate_light(const BallPicture& picture, const core::CameraModel& camera, const Sphere& ball,
                             double stage_radius_m);

// Joins estimates of the same lights from several balls or cameras: weighted mean direction; an estimate more than three combined
// sigmas and 1 degree away from a better one is left out. Lights placed by nobody keep the first reason.
std::vector<LightEstimate> combine_estimates(std::span<const std::vector<LightEstimate>> per_ball);

}  // namespace lightstage::calib
