// Soft shadows without bands: how many directions an area light needs.
#include <catch2/catch.hpp>
#include <numbers>

#include "core/error.h"
#include "core/sphere.h"
#include "model/methods.h"
#include "model/synthetic_scan.h"
#include "relight/relight.h"

namespace lightstage {

namespace {

using core::Direction;
using core::Image;

constexpr double kPi = std::numbers::pi;

// A wall as far away as the picture is half high, seen from the front, and before it a screen that covers its left half: the
// shadow's edge is one pixel soft, and moves by height/2 tan(angle). Above it a glossy strip, whose highlight is as wide as
// the spacing of the lights.
test::PixelFunction wall(core::ImageSize size, double spacing) {
  return [=](const Direction& light, int y, int x, int) {
    if (light.z() <= 0) return 0.0;
    if (y < size.height / 4) {
      const double normal_angle = 1.2 * (double(x) / size.width - 0.5);
      const Direction mirror = Direction::from_vector({std::sin(2 * normal_angle), 0, std::cos(2 * normal_angle)});
      const double off = core::angle_radians(mirror, light) / spacing;
      return std::exp(-2 * off * off);
    }
    const double edge = 0.5 * (size.width - 1) - 0.5 * size.height * light.x() / light.z();
    return light.z() * std::clamp(double(x) - edge + 0.5, 0.0, 1.0);
  };
}

constexpr core::ImageSize kSize{96, 64, 1};
constexpr std::size_t kLights = 302;

// Shows the wall itself under every light: the hardest case, since nothing blurs the edge.
class TrueWall : public model::LightInterpolator {
 public:
  TrueWall()
      : scan_(test::scan_of(core::fibonacci_directions(kLights), kSize, wall(kSize, 1))),
        value_(wall(kSize, core::median_spacing_radians(scan_.directions()))) {}
  std::string_view name() const override { return "true"; }
  const core::OlatScan& scan() const override { return scan_; }
  Image render(const Direction& query) const override {
    // All rows of the strip are alike, and all of the wall.
    Image picture(kSize);
    for (int y = 0; y < kSize.height; ++y)
      for (int x = 0; x < kSize.width; ++x)
        picture(y, x) = y == 0 || y == kSize.height / 4 ? float(value_(query, y, x, 0)) : picture(y - 1, x);
    return picture;
  }

 private:
  core::OlatScan scan_;
  test::PixelFunction value_;
};

double largest_difference(const Image& a, const Image& b) {
  double largest = 0;
  for (std::size_t i = 0; i < a.values().size(); ++i)
    largest = std::max(largest, std::abs(double(a.values()[i]) - double(b.values()[i])));
  return largest;
}

// How much more the steep places of a penumbra step from pixel to pixel than those of the reference.
double band(const Image& picture, const Image& reference) {
  double largest = 0;
  const int y = kSize.height - 1;
  for (int x = 0; x + 1 < kSize.width; ++x) {
    const double step = double(picture(y, x + 1)) - double(picture(y, x));
    const double expected = double(reference(y, x + 1)) - double(reference(y, x));
    largest = std::max(largest, std::abs(step - expected));
  }
  return largest;
}

}  // namespace

TEST_CASE("an area light's samples grow with its radius, the picture and the density of the stage") {
  const TrueWall wall;
  CHECK(relight::area_samples(wall, 0) == 1);
  CHECK(relight::area_samples(wall, 1e-9) == 1);
  int before = 1;
  for (const double radius : {0.27, 1.0, 5.0, 10.0, 20.0, 30.0, 90.0, 180.0}) {
    const int samples = relight::area_samples(wall, radius);
    CHECK(samples >= kSize.height * radius * kPi / 180);
    CHECK(samples >= before);
    before = samples;
  }
  CHECK(relight::area_samples(wall, 180) < 10000);
  CHECK_THROWS_AS(relight::area_samples(wall, -1), core::UsageError);
  CHECK_THROWS_AS(relight::area_samples(wall, std::nan("")), core::UsageError);
}

TEST_CASE("directions on a cap lie within it, around its middle, the only one on it") {
  const Direction axis = Direction::from_vector({1, 2, -1});
  CHECK(relight::cap_directions(axis, 70, 1) == std::vector{axis});
  for (const double radius : {1e-6, 3.0, 90.0, 180.0})
    for (const int samples : {2, 50, 501}) {
      const std::vector<Direction> cap = relight::cap_directions(axis, radius, samples);
      REQUIRE(cap.size() == std::size_t(samples));
      for (const Direction& d : cap) REQUIRE(core::angle_radians(d, axis) <= radius * kPi / 180 * (1 + 1e-9));
    }
}

TEST_CASE("soft shadows and highlights are those of 2000 samples, without bands") {
  const TrueWall wall;
  const Direction light = Direction::from_vector({0.1, 0.2, 1});
  for (const double radius : {0.27, 1.0, 3.0, 10.0, 20.0, 30.0}) {
    CAPTURE(radius, relight::area_samples(wall, radius));
    const Image dense = relight::relight_area(wall, light, radius, 2000).image;
    const Image own = relight::relight_area(wall, light, radius).image;
    CHECK(largest_difference(own, dense) < 0.0125);
    CHECK(band(own, dense) < 0.0125);
  }
  // The number that was once taken for all.
  const Image dense = relight::relight_area(wall, light, 30, 2000).image;
  const Image few = relight::relight_area(wall, light, 30, 64).image;
  CHECK(largest_difference(few, dense) > 0.02);
  CHECK(band(few, dense) > 0.02);
}

TEST_CASE("under area lights methods of captured pictures give what 2000 samples do, in one weighted sum") {
  const core::OlatScan scan = test::scan_of(core::fibonacci_directions(100), {24, 25, 3}, test::matt_ball({24, 25, 3}));
  for (const char* name : {"nearest", "linear", "rbf"})
    for (const double radius : {0.5, 5.0, 30.0, 120.0}) {
      CAPTURE(name, radius);
      model::MethodOptions options;
      options.domain = model::Domain::kLinear;
      const auto method = model::make_interpolator(name, scan, options);
      const Direction light = Direction::from_vector({-1, 0.5, 2});
      const relight::RelightReport own = relight::relight_area(*method, light, radius);
      CHECK(own.directions_synthesised == 0);
      const double most = std::string(name) == "nearest" ? 0.01 : 0.002;
      CHECK(largest_difference(own.image, relight::relight_area(*method, light, radius, 2000).image) < most);
    }
}

TEST_CASE("several lights together are the sum of each alone") {
  const TrueWall wall;
  const std::vector<relight::AreaLight> lights{{Direction::from_vector({0.5, 0, 1}), 0, {1, 0.5, 0}},
                                               {Direction::from_vector({-0.5, 0.3, 1}), 4, {0, 2, 0.25}}};
  const Image both = relight::relight_area_lights(wall, lights, 20).image;
  const Image first = relight::relight_area_lights(wall, std::span(lights).first(1), 20).image;
  const Image second = relight::relight_area(wall, lights[1].direction, 4, 20, lights[1].irradiance).image;
  for (std::size_t v = 0; v < both.values().size(); ++v)
    REQUIRE(both.values()[v] == Approx(double(first.values()[v]) + double(second.values()[v])).margin(1e-6));
  CHECK(relight::relight_area_lights(wall, lights, 20).directions_synthesised == 21);
  CHECK(relight::relight_area_lights(wall, {}, 20).image == Image(kSize.height, kSize.width, 3));
}

}  // namespace lightstage
