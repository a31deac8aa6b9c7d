#include "relight/relight.h"

#include <cmath>
#include <string>
#include <vector>

#include "core/error.h"
#include "core/interrupt.h"
#include "core/sphere.h"
#include "core/stopwatch.h"
#include "model/picture_sum.h"

namespace lightstage::relight {

namespace {

void require_light(core::Vec3 irradiance) {
  for (const double v : {irradiance.x, irradiance.y, irradiance.z})
    if (!std::isfinite(v) || v < 0)
      throw core::BadInput("a light's irradiance must be finite and not negative, not " + std::to_string(v));
}

}  // namespace

RelightReport relight_lights(const model::LightInterpolator& interpolator, std::span<const DistantLight> lights) {
  const core::Stopwatch stopwatch;
  for (const DistantLight& light : lights) require_light(light.irradiance);
  RelightReport report;
  const std::vector<core::Vec3> colours = interpolator.captured_colours(lights);
  if (!colours.empty()) {
    report.image = interpolator.lit_by(colours);
  } else {
    const core::ImageSize size = interpolator.scan().image_size();
    model::PictureSum sum({size.height, size.width, 3});
    std::vector<core::Direction> directions;
    for (const DistantLight& light : lights) directions.push_back(light.direction);
    for (const std::size_t i : core::neighbouring_order(directions)) {  // neighbours share captured images
      const DistantLight& light = lights[i];
      if (light.irradiance == core::Vec3{}) continue;
      core::throw_if_interrupted();
      const core::Image picture = interpolator.render(light.direction);
      sum.add(picture.channels() == 3 ? picture : core::to_rgb(picture), light.irradiance);
      ++report.directions_synthesised;
    }
    report.image = sum.result();
  }
  report.seconds = stopwatch.seconds();
  return report;
}

RelightReport relight_direction(const model::LightInterpolator& interpolator, const core::Direction& light,
                                core::Vec3 irradiance) {
  const DistantLight one{light, irradiance};
  return relight_lights(interpolator, std::span(&one, 1));
}

RelightReport relight_area_lights(const model::LightInterpolator& interpolator, std::span<const AreaLight> lights,
                                  std::optional<int> samples) {
  const core::Stopwatch stopwatch;
  std::vector<DistantLight> parts;
  for (const AreaLight& light : lights) {
    if (light.radius_degrees == 0) {
      parts.push_back({light.direction, light.irradiance});
      continue;
    }
    const int count = samples ? *samples : area_samples(interpolator, light.radius_degrees);
    for (const core::Direction& d : cap_directions(light.direction, light.radius_degrees, count))
      parts.push_back({d, light.irradiance / double(count)});
  }
  RelightReport report = relight_lights(interpolator, parts);
  report.seconds = stopwatch.seconds();
  return report;
}

RelightReport relight_area(const model::LightInterpolator& interpolator, const core::Direction& light,
                           double radius_degrees, std::optional<int> samples, core::Vec3 irradiance) {
  const AreaLight one{light, radius_degrees, irradiance};
  return relight_area_lights(interpolator, std::span(&one, 1), samples);
}

}  // namespace lightstage::relight
