// What a grey ball shows of a light whose place and gain are known: whether both still hold.
#pragma once

#include <array>
#include <string>

#include "calib/sphere_fit.h"
#include "core/camera_model.h"
#include "core/image.h"
#include "core/vec3.h"

namespace lightstage::calib {

// What a light was calibrated as.
struct KnownLight {
  core::Vec3 position;  // metres, stage frame
  std::array<double, 3> gain{1, 1, 1};
};

struct ShadingResidual {
  bool compared = false;
  std::string reason;                         // why not
  std::array<double, 3> gain_ratio{1, 1, 1};  // of the picture over the prediction, channel by channel
  double gain_sigma = 0;                      // standard error of these, relative
  double degrees = 0;                         // by which the light seems to have turned about stage centre
  double degrees_sigma =
      0;                // standard error of that, both coordinates together; 180 where the ball is dark (all ratios 0)
  double residual = 0;  // root mean square of picture less prediction over the prediction's
};

// Least squares over the pixels that should be lit, weighted by their photon noise: per channel a factor on the prediction albedo gain cos (R/d)^2
// (calib/light_gain.h), and for all together a turn of the light along two tangents, since a Lambertian surface's radiance is linear in the
// direction to the light. Pixels four robust standard deviations off are left out. Standard errors are those of scatter and of the ball's outline, which shifts
// all normals. `picture` and `saturation` as for estimate_gain. Not compared when fewer than 64 pixels are lit, seen and not clipped, or the light's
// gain is 0. Throws BadInput as estimate_gain.
ShadingResidual compare_shading(core::ImageView picture, const core::CameraModel& camera, const Sphere& ball,
                                double albedo, const KnownLight& light, double saturation = 0);

}  // namespace lightstage::calib
