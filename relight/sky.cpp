#include "relight/sky.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "core/error.h"

namespace lightstage::relight {

namespace {

constexpr double kPi = std::numbers::pi;
constexpr double kSunRadius = 0.53 / 2 * kPi / 180;
constexpr core::Vec3 kSkyColour{0.62, 0.86, 1.42};  // about 12000 K, luminance near 1
constexpr core::Vec3 kSunColour{1.28, 0.96, 0.68};  // about 4500 K, low sun

// ISO 15469, equation 1 with the parameters of sky type 12: gradation a, b towards the horizon, and the
// scattering indicatrix c, d, e about the sun. `zenith` is the element's angle from the zenith.
double relative_luminance(double zenith, double angle_to_sun, double sun_zenith) {
  // NOLINTNEXTLINE(readability-identifier-naming): as ISO 15469 calls them
  constexpr double a = -1, b = -0.32, c = 10, d = -3, e = 0.45;
  const auto gradation = [](double z) { return 1 + a * std::exp(b / std::max(std::cos(z), 1e-3)); };
  const auto indicatrix = [](double x) {
    return 1 + c * (std::exp(d * x) - std::exp(d * kPi / 2)) + e * std::cos(x) * std::cos(x);
  };
  return gradation(zenith) * indicatrix(angle_to_sun) / (gradation(0) * indicatrix(sun_zenith));
}

void add(core::Image& map, int y, int x, core::Vec3 radiance) {
  map(y, x, 0) += float(radiance.x);
  map(y, x, 1) += float(radiance.y);
  map(y, x, 2) += float(radiance.z);
}

}  // namespace

Environment clear_sky(const SkyOptions& options) {
  if (options.sun.y() <= 0) throw core::UsageError("the sun must stand above the horizon (latitude above 0 degrees)");
  if (options.height < 8) throw core::UsageError("a sky map needs a height of at least 8 pixels");
  const int height = options.height, width = 2 * height;
  const Environment frame{core::Image(height, width, 3)};  // for its directions and solid angles
  const double sun_zenith = std::acos(std::clamp(options.sun.y(), -1.0, 1.0));

  core::Image map(height, width, 3);
  double sky_irradiance = 0;
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      const core::Direction direction = frame.direction(y, x);
      if (direction.y() <= 0) continue;
      const double luminance = relative_luminance(std::acos(std::min(direction.y(), 1.0)),
                                                  core::angle_radians(direction, options.sun), sun_zenith);
      sky_irradiance += luminance * direction.y() * frame.solid_angle(y);
      add(map, y, x, kSkyColour * luminance);
    }
  }
  for (float& value : map.values()) value = float(value * kPi / sky_irradiance);

  // The sun's light goes to the pixels whose centres lie on its disc, or, since it is smaller than most maps' pixels, to the
  // nearest one: energy is kept either way.
  const double radius = std::max(kSunRadius, 0.75 * kPi / height);
  double covered = 0;
  const auto inside = [&](int y, int x) { return core::angle_radians(frame.direction(y, x), options.sun) <= radius; };
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      if (inside(y, x)) covered += frame.solid_angle(y);
    }
  }
  const double sun_irradiance = options.sun_to_sky * kPi;
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      if (inside(y, x)) add(map, y, x, kSunColour * (sun_irradiance / covered));
    }
  }
  const core::Vec3 on_ground = kSkyColour * kPi + kSunColour * (sun_irradiance * options.sun.y());
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      if (frame.direction(y, x).y() <= 0) add(map, y, x, on_ground * (options.ground_albedo / kPi));
    }
  }
  return Environment(map);
}

}  // namespace lightstage::relight
