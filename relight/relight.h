// The subject under new light. Light adds up: every picture here is a sum of pictures under single lights.
#pragma once

#include <cstddef>
#include <optional>
#include <span>

#include "core/direction.h"
#include "core/image.h"
#include "core/vec3.h"
#include "model/interpolator.h"
#include "relight/area_light.h"

namespace lightstage::relight {

using model::DistantLight;

struct RelightReport {
  core::Image image;  // linear radiance, 3 channels
  std::size_t directions_synthesised =
      0;               // pictures asked of the interpolator; 0 where captured images were summed as they are
  double seconds = 0;  // wall clock
};

// All functions: images of grey scans count as RGB; sums are in float64 in a fixed order, so that the result
// does not depend on the thread count; an irradiance that is negative or not finite throws BadInput. Memory:
// two pictures and the sum (see model::PictureSum).

// The sum over any lights. For methods with linear weights the captured images are summed once, however many
// lights there are; for all others each light with any irradiance is synthesised in turn.
RelightReport relight_lights(const model::LightInterpolator& interpolator, std::span<const DistantLight> lights);

// One distant light of colour `irradiance` (units of pi; {1,1,1} is one stage light).
RelightReport relight_direction(const model::LightInterpolator& interpolator, const core::Direction& light,
                                core::Vec3 irradiance = {1, 1, 1});

// Round lights, each the mean over directions placed evenly on its cap (cap_directions): `samples` of them, or as many as
// it needs (area_samples). A radius of 0 is relight_direction. Methods with linear weights make one weighted sum for
// all lights together. Throws UsageError for a radius out of range or less than one sample.
RelightReport relight_area_lights(const model::LightInterpolator& interpolator, std::span<const AreaLight> lights,
                                  std::optional<int> samples = {});

// One of them, of angular radius `radius_degrees` (0 to 180) about `light` and of total `irradiance`.
RelightReport relight_area(const model::LightInterpolator& interpolator, const core::Direction& light,
                           double radius_degrees, std::optional<int> samples = {}, core::Vec3 irradiance = {1, 1, 1});

}  // namespace lightstage::relight
