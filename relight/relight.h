// The subject under new light. Light adds up: every picture here is a sum of pictures under single lights.
#pragma once

#include <cstddef>

#include "core/direction.h"
#include "core/image.h"
#include "core/vec3.h"
#include "model/interpolator.h"
#include "relight/environment.h"

namespace lightstage::relight {

struct RelightReport {
  core::Image image;                    // linear radiance, 3 channels
  std::size_t directions_synthesised = 0;  // pictures asked of the interpolator
  double seconds = 0;
};

// One distant light of colour `irradiance` (units of pi; {1,1,1} is one stage light).
RelightReport relight_direction(const model::LightInterpolator& interpolator, const core::Direction& light,
                                core::Vec3 irradiance = {1, 1, 1});

// A round light of angular radius `radius_degrees` (0 to 180) about `light`, uniform, of total `irradiance`: the mean over `samples`
// directions placed evenly on the cap (equal area, Fibonacci spiral). A radius of 0 is relight_direction.
RelightReport relight_area(const model::LightInterpolator& interpolator, const core::Direction& light, double radius_degrees,
                           int samples, core::Vec3 irradiance = {1, 1, 1});

// A whole environment. For methods with linear weights every pixel of the map is carried by the captured images in one weighted sum. For all
// others the map is gathered onto `virtual_lights` directions and each that receives light is synthesised.
// Memory: two images; the sum is in float64.
RelightReport relight_environment(const model::LightInterpolator& interpolator, const Environment& environment,
                                  std::size_t virtual_lights);

}  // namespace lightstage::relight
