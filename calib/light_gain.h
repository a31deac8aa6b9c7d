// Light intensity and colour from a grey ball.
#pragma once

#include <array>
#include <string>

#include "calib/sphere_fit.h"
#include "core/camera_model.h"
#include "core/image.h"
#include "core/vec3.h"

namespace lightstage::calib {

struct GainEstimate {
  bool measured = false;
  std::array<double, 3> gain{1, 1, 1};  // irradiance at stage centre in units of pi (core::Light::gain)
  std::array<double, 3> sigma{};        // standard errors
  double relative_sigma = 0;            // of a channel's gain over the gain, root of the mean square over the channels
  std::string reason;                   // why it was not measured
};

// Of a light whose place is known exactly.
inline constexpr core::Mat3 kExactPlace{{core::Vec3{0, 0, 0}, core::Vec3{0, 0, 0}, core::Vec3{0, 0, 0}}};

// `picture` shows a Lambertian ball of known albedo lit by one light at `light_position` (stage frame), linear, free of ambient
// light, divided by the camera's flat field where there is one; `saturation` as in CameraFrame (clipped pixels are left out). Fits radiance = albedo gain max(cos, 0) (R/d)^2 over the
// lit and seen pixels (R: the light's distance from stage centre, d from the surface point) by weighted least squares; pixels at the rim, at
// grazing light and far off the fit (dust, gloss) are left out. Together with the gains are fitted, within what is known of them, the light's place
// (`light_covariance`, square metres; kExactPlace: it is taken as exact) and the ball's outline (calib/ball/cone.h): the shading of
// thousands of pixels tells most directions better than a highlight does, and what it cannot tell, as of lights behind the ball, is in the standard errors.
// An error of the albedo, a fault of the ball or vignetting that was not divided out are not.
// Grey pictures give one gain for all channels. Not measured when fewer than 64 pixels are lit, seen and not clipped, or the ball is dark.
// Throws BadInput for an albedo that is not positive, a light inside the ball, a picture of another size than the camera's, with
// other than 1 or 3 channels, or with values that are not finite, and for a covariance that is not one.
GainEstimate estimate_gain(core::ImageView picture, const core::CameraModel& camera, const Sphere& ball, double albedo,
                           core::Vec3 light_position, double saturation = 0,
                           const core::Mat3& light_covariance = kExactPlace);

}  // namespace lightstage::calib
