#include <catch2/catch.hpp>
#include <numbers>

#include "core/error.h"
#include "relight/sky.h"

using namespace lightstage;

namespace {

// Irradiance of the map's upper half on a surface facing `normal`.
double irradiance(const relight::Environment& sky, const core::Direction& normal, int channel) {
  double sum = 0;
  for (int y = 0; y < sky.height(); ++y) {
    for (int x = 0; x < sky.width(); ++x) {
      const core::Direction d = sky.direction(y, x);
      if (d.y() > 0)
        sum += sky.radiance()(y, x, channel) * sky.solid_angle(y) * std::max(0.0, core::dot(d.vec(), normal.vec()));
    }
  }
  return sum;
}

}  // namespace

TEST_CASE("a sky without sun lights the ground with pi, whatever the size of the map") {
  for (const int height : {8, 31, 128}) {
    const auto sky = relight::clear_sky({.height = height, .sun_to_sky = 0});
    const double green = irradiance(sky, core::Direction::from_vector({0, 1, 0}), 1);
    CHECK(green == Approx(0.86 * std::numbers::pi).epsilon(1e-5));
  }
}

TEST_CASE("the sun's light does not depend on the map's resolution, and stands where it was asked to") {
  const auto sun = core::Direction::from_longitude_latitude_degrees(-120, 20);
  for (const int height : {16, 64, 400}) {
    const auto with = relight::clear_sky({.sun = sun, .height = height, .sun_to_sky = 4});
    const auto without = relight::clear_sky({.sun = sun, .height = height, .sun_to_sky = 0});
    const double red = irradiance(with, sun, 0) - irradiance(without, sun, 0);
    CHECK(red == Approx(1.28 * 4 * std::numbers::pi).epsilon(0.02));
    double brightest = 0;
    core::Direction where;
    for (int y = 0; y < height; ++y) {
      for (int x = 0; x < 2 * height; ++x) {
        if (with.radiance()(y, x, 0) > brightest) {
          brightest = with.radiance()(y, x, 0);
          where = with.direction(y, x);
        }
      }
    }
    CHECK(core::angle_radians(where, sun) < 1.1 * std::numbers::pi / height);
  }
}

TEST_CASE("a sun below the horizon is refused") {
  CHECK_THROWS_AS(relight::clear_sky({.sun = core::Direction::from_longitude_latitude_degrees(0, -1)}),
                  core::UsageError);
}
