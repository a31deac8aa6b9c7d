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
  core::Pixel position;  // sub-pixel
  double peak = 0;       // brightest value, linear
  double sigma_px = 0;   // standard error of the position
  bool clipped = false;  // the peak is at the sensor's limit
  double rival = 0;      // light in the next strongest spot on the ball over that in this one
  bool parted = false;   // it is two spots that touch
};

// The brightest compact spot on the ball, to a few hundredths of a pixel. Of the connected pixels that stand above the ball around
// the spot, an unclipped spot's centroid is weighted by height; a clipped one's by the logarithm of height, between the noise and the
// clipping level, which makes of its steep edge partly covered pixels. Streaks of glare, single hot pixels, the ball's own
// shading and a second, dimmer spot (inter-reflection) do not count. Nothing when no spot stands out (seven standard deviations of the
// noise) or it is larger than a quarter of the ball's radius. `saturation` is the value at which the sensor clips (0: unknown; a
// plateau then shows it). Throws BadInput for a picture of another size than the camera's or values that are not finite.
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
// With a second spot of more than this share of the light nobody can tell which one is the lamp.
constexpr double kDoubleShare = 0.5;

struct LightEstimate {
  int light_index = 0;
  bool placed = false;
  core::Direction direction;  // from stage centre
  core::Vec3 position;        // metres, on the stage's sphere
  double sigma_degrees = 0;   // standard error from highlight and outline; 180 where the rim is within it
  std::string reason;         // why it was not placed
  std::optional<Highlight> highlight;
};

// One picture of the ball lit by one light, free of ambient light.
struct BallPicture {
  int light_index = 0;
  core::Image image;
  double saturation = 0;
};

// Follows the reflected ray to the sphere of radius `stage_radius_m` about the stage centre, since a light at finite distance lies in
// another direction from the ball's surface than from the centre. Its sigma comes from moving highlight and ball by their
// standard errors: towards the rim the direction turns ever faster, so that lights nearly behind the ball are the least certain.
// Not placed are lights without a highlight (dead, hidden, behind the ball), with two of like strength (kDoubleShare) or two that touch, with one cut by the
// picture's border, on a ball that is clipped for the most part, and beyond largest_sigma_degrees; `reason` says which. Throws BadInput when the ball is not
// inside that sphere, and as find_highlight.
LightEstimate estimate_light(const BallPicture& picture, const core::CameraModel& camera, const Sphere& ball,
                             double stage_radius_m, double largest_sigma_degrees = kLargestSigmaDegrees);

// Joins estimates of the same lights from several balls or cameras: weighted mean direction; an estimate more than three combined
// sigmas and 1 degree away from a better one is left out. Lights placed by nobody keep the first reason.
std::vector<LightEstimate> combine_estimates(std::span<const std::vector<LightEstimate>> per_ball);

}  // namespace lightstage::calib
