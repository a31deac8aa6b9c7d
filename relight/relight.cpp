#include "relight/relight.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <numbers>
#include <string>
#include <vector>

#include "core/error.h"
#include "core/interrupt.h"
#include "core/sphere.h"
#include "model/picture_sum.h"

namespace lightstage::relight {

namespace {

using Timer = std::chrono::steady_clock;

double seconds_since(Timer::time_point start) {
  return std::chrono::duration<double>(Timer::now() - start).count();
}

void require_light(core::Vec3 irradiance) {
  for (const double v : {irradiance.x, irradiance.y, irradiance.z})
    if (!std::isfinite(v) || v < 0)
      throw core::BadInput("a light's irradiance must be finite and not negative, not " + std::to_string(v));
}

// Evenly placed on the cap: the k-th of n has 1 - cos(angle to the axis) = (k + 1/2)/n of the cap's, and
// successive ones turn by the golden angle.
std::vector<core::Direction> cap_directions(const core::Direction& axis, double radius_radians, int samples) {
  const core::Vec3 z = axis.vec();
  const core::Vec3 least = std::abs(z.y) < 0.9 ? core::Vec3{0, 1, 0} : core::Vec3{1, 0, 0};
  const core::Vec3 x = core::Direction::from_vector(core::cross(least, z)).vec();
  const core::Vec3 y = core::cross(z, x);
  const double half_sine = std::sin(radius_radians / 2);
  const double cap_height = 2 * half_sine * half_sine;  // 1 - cos(radius), exact for small ones
  const double golden_angle = 2 * std::numbers::pi * (2 - std::numbers::phi);
  std::vector<core::Direction> directions;
  for (int k = 0; k < samples; ++k) {
    const double height = cap_height * (double(k) + 0.5) / double(samples);
    const double radius = std::sqrt(height * (2 - height));
    const double turn = golden_angle * double(k);
    directions.push_back(
        core::Direction::from_vector((1 - height) * z + (radius * std::cos(turn)) * x + (radius * std::sin(turn)) * y));
  }
  return directions;
}

}  // namespace

RelightReport relight_lights(const model::LightInterpolator& interpolator, std::span<const DistantLight> lights) {
  const Timer::time_point start = Timer::now();
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
  report.seconds = seconds_since(start);
  return report;
}

RelightReport relight_direction(const model::LightInterpolator& interpolator, const core::Direction& light,
                                core::Vec3 irradiance) {
  const DistantLight one{light, irradiance};
  return relight_lights(interpolator, std::span(&one, 1));
}

RelightReport relight_area(const model::LightInterpolator& interpolator, const core::Direction& light,
                           double radius_degrees, int samples, core::Vec3 irradiance) {
  if (!(radius_degrees >= 0 && radius_degrees <= 180))
    throw core::UsageError("the radius of an area light must be 0 to 180 degrees, not " +
                           std::to_string(radius_degrees));
  if (samples < 1) throw core::UsageError("an area light needs at least 1 sample, not " + std::to_string(samples));
  if (radius_degrees == 0) return relight_direction(interpolator, light, irradiance);
  std::vector<DistantLight> lights;
  for (const core::Direction& d : cap_directions(light, core::radians_from_degrees(radius_degrees), samples))
    lights.push_back({d, irradiance / double(samples)});
  return relight_lights(interpolator, lights);
}

RelightReport relight_environment(const model::LightInterpolator& interpolator, const Environment& environment,
                                  std::size_t virtual_lights) {
  if (virtual_lights == 0) throw core::UsageError("an environment needs at least 1 virtual light");
  const Timer::time_point start = Timer::now();
  // Weights vary over distances of the light spacing D. A box of side D/8 whose light stands at its mean
  // direction errs first in the second moment, (D/8)^2/12 an axis: with a second derivative of about 2/D^2
  // (that of the alias-free weights at their default sharpness) that is at most 0.3 % of one box's light, and
  // less over the map, where signs alternate.
  constexpr double kBoxesPerSpacing = 8;
  const bool has_linear_weights = !interpolator.linear_weights(core::Direction()).empty();
  const std::vector<DistantLight> lights =
      has_linear_weights
          ? environment.lights(core::median_spacing_radians(interpolator.scan().directions()) / kBoxesPerSpacing)
          : environment.gather(core::fibonacci_directions(virtual_lights));
  RelightReport report = relight_lights(interpolator, lights);
  report.seconds = seconds_since(start);
  return report;
}

}  // namespace lightstage::relight
