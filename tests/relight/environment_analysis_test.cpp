// What is said of an environment, where it is known.
#include <catch2/catch.hpp>
#include <numbers>
#include <random>

#include "core/parallel.h"
#include "relight/environment_analysis.h"
#include "relight/harmonics.h"
#include "relight/sky.h"
#include "support/support.h"

namespace lightstage {

namespace {

using core::Direction;
using core::Image;
using relight::Environment;
using relight::EnvironmentAnalysis;
using relight::SmallSources;
using relight::Verdict;

constexpr double kPi = std::numbers::pi;

Image constant(int height, int width, float value) {
  Image map(height, width, 3);
  std::fill(map.values().begin(), map.values().end(), value);
  return map;
}

// Adds radiance to the pixels whose centres are within a radius, and returns their solid angle.
double add_disc(Image& map, const Direction& centre, double radius_degrees, float radiance) {
  const Environment frame(Image(map.height(), map.width(), 3));
  double solid_angle = 0;
  for (int y = 0; y < map.height(); ++y)
    for (int x = 0; x < map.width(); ++x) {
      if (core::angle_radians(frame.direction(y, x), centre) > core::radians_from_degrees(radius_degrees)) continue;
      for (int c = 0; c < 3; ++c) map(y, x, c) += radiance;
      solid_angle += frame.solid_angle(y);
    }
  return solid_angle;
}

// The share as the header words it, every pixel against every other.
double plain_share(const Environment& map) {
  double all = 0, standing_out = 0;
  const auto brightness = [&](int y, int x) {
    const float* p = map.radiance().pixel(y, x);
    return double(p[0]) + double(p[1]) + double(p[2]);
  };
  for (int y = 0; y < map.height(); ++y)
    for (int x = 0; x < map.width(); ++x) {
      std::vector<std::pair<double, double>> disc;
      double area = 0;
      for (int i = 0; i < map.height(); ++i)
        for (int j = 0; j < map.width(); ++j) {
          if (core::dot(map.direction(y, x).vec(), map.direction(i, j).vec()) < std::cos(8 * kPi / 180) &&
              (i != y || j != x))
            continue;
          disc.emplace_back(brightness(i, j), map.solid_angle(i));
          area += map.solid_angle(i);
        }
      std::sort(disc.begin(), disc.end());
      std::size_t k = 0;
      for (double below = disc[0].second; below < 0.6 * area; below += disc[k].second) ++k;
      standing_out += std::max(0.0, brightness(y, x) - 2 * disc[k].first) * map.solid_angle(y);
      all += brightness(y, x) * map.solid_angle(y);
    }
  return standing_out / all;
}

}  // namespace

TEST_CASE("an even sky is of degree 0 and blending suffices; so it does without any light") {
  for (const float value : {0.0f, 0.7f, 1e30f})
    for (const auto& [height, width] : {std::pair{1, 1}, {1, 2}, {2, 1}, {64, 128}}) {
      const EnvironmentAnalysis analysis = relight::analyse(Environment(constant(height, width, value)));
      REQUIRE(analysis.energy_by_degree.size() == 51);
      CHECK(analysis.degree_90 == 0);
      CHECK(analysis.verdict == Verdict::kLinear);
      CHECK(analysis.share_above_50 == Approx(0).margin(1e-7));
      CHECK(analysis.small_sources.share == 0);
      CHECK_FALSE(analysis.small_sources.brightest.has_value());
    }
}

TEST_CASE("a point has degree 48, and is found as the one source: anywhere, however bright") {
  for (const auto& [y, x] : {std::pair{0, 0}, {60, 511}, {128, 256}, {255, 3}})
    for (const float radiance : {1e-20f, 1e6f, 1e30f}) {
      CAPTURE(y, x, radiance);
      Image image(256, 512, 3);
      image(y, x, 1) = radiance;
      const Environment map(image);
      const EnvironmentAnalysis analysis = relight::analyse(map);
      CHECK(analysis.degree_90 == 48);
      CHECK(analysis.share_above_50 > 0.9);
      CHECK(analysis.verdict == Verdict::kSuperResolution);
      CHECK(analysis.small_sources.share == Approx(1));
      REQUIRE(analysis.small_sources.brightest.has_value());
      CHECK(core::angle_radians(analysis.small_sources.brightest->direction, map.direction(y, x)) < 1e-6);
      CHECK(analysis.small_sources.brightest->share == Approx(1));
      const double solid_angle =
          2 * kPi * (1 - std::cos(core::radians_from_degrees(analysis.small_sources.brightest->diameter_degrees / 2)));
      CHECK(solid_angle == Approx(map.solid_angle(y)).epsilon(1e-6));
    }
}

TEST_CASE("a sun of a millionth of the sphere in one pixel of a bright sky is told by its excess") {
  Image image = constant(128, 256, 1);
  for (int c = 0; c < 3; ++c) image(40, 100, c) = 1e6f;
  const Environment map(image);
  const SmallSources sources = relight::small_sources(map);
  const double sun = map.solid_angle(40), all = 4 * kPi + (1e6 - 1) * sun;
  CHECK(sources.share == Approx((1e6 - 2) * sun / all).epsilon(1e-6));
  CHECK(relight::analyse(map).verdict == Verdict::kSuperResolution);
}

TEST_CASE("discs to 10 degrees across are small sources, in their place and of their size; wider ones are none") {
  for (const auto& [longitude, latitude] :
       {std::pair{0.0, 0.0}, {180.0, 10.0}, {77.0, 90.0}, {-100.0, -86.0}, {33.0, 60.0}}) {
    const Direction centre = Direction::from_longitude_latitude_degrees(longitude, latitude);
    for (const double radius : {1.0, 3.0, 4.5}) {
      CAPTURE(longitude, latitude, radius);
      Image image = constant(256, 512, 0.01f);
      const double solid_angle = add_disc(image, centre, radius, 5);
      const double all = 4 * kPi * 0.01 + 5 * solid_angle;
      const SmallSources sources = relight::small_sources(Environment(image));
      CHECK(sources.share == Approx(4.99 * solid_angle / all).epsilon(0.02));
      REQUIRE(sources.brightest.has_value());
      CHECK(sources.brightest->share == Approx(sources.share));
      CHECK(core::angle_radians(sources.brightest->direction, centre) < kPi / 256);
      const double diameter = 4 * core::degrees_from_radians(std::asin(std::sqrt(solid_angle / (4 * kPi))));
      CHECK(sources.brightest->diameter_degrees == Approx(diameter).epsilon(0.01));
    }
    Image panel = constant(256, 512, 0.01f);
    add_disc(panel, centre, 15, 5);
    CHECK(relight::small_sources(Environment(panel)).share < 0.01);
  }
}

TEST_CASE("the share of small sources is the plain one") {
  for (const auto& [height, width] : {std::pair{1, 2}, {26, 50}, {33, 61}}) {
    std::mt19937 random(3);
    Image image(height, width, 3);
    for (float& value : image.values()) value = float(random() % 1000) * float(random() % 1000) * 1e-6f;
    CAPTURE(height, width);
    CHECK(relight::small_sources(Environment(image)).share == Approx(plain_share(Environment(image))).epsilon(1e-9));
  }
}

TEST_CASE("sources are counted by their light and told apart; the brightest is the one with the most light") {
  Image image(256, 512, 3);
  const Direction strong = Direction::from_longitude_latitude_degrees(179.9, 30);
  const double a = add_disc(image, strong, 2, 10);
  const double b = add_disc(image, Direction::from_longitude_latitude_degrees(-20, -40), 1, 25);
  const SmallSources sources = relight::small_sources(Environment(image));
  CHECK(sources.share == Approx(1));
  CHECK(sources.brightest->share == Approx(10 * a / (10 * a + 25 * b)).epsilon(1e-4));
  CHECK(core::angle_radians(sources.brightest->direction, strong) < 0.01);
}

TEST_CASE("what is said of a sky does not depend on the map's size, and turns with it") {
  const auto at = [](int height) {
    return relight::analyse(relight::clear_sky(
        {.sun = Direction::from_longitude_latitude_degrees(50, 35), .height = height, .sun_to_sky = 4}));
  };
  const EnvironmentAnalysis reference = at(512);
  CHECK(reference.verdict == Verdict::kSuperResolution);
  CHECK(reference.small_sources.brightest->diameter_degrees == Approx(0.53).epsilon(0.1));
  for (const int height : {64, 128, 300}) {
    CAPTURE(height);
    const EnvironmentAnalysis analysis = at(height);
    CHECK(analysis.degree_90 == Approx(reference.degree_90).margin(3));
    CHECK(analysis.small_sources.share == Approx(reference.small_sources.share).epsilon(0.03));
  }
  const Environment sky = relight::clear_sky({.height = 128, .sun_to_sky = 4});
  const EnvironmentAnalysis before = relight::analyse(sky);
  for (const double degrees : {90.0, 133.3}) {
    const EnvironmentAnalysis turned = relight::analyse(sky.rotated(degrees));
    CHECK(turned.degree_90 == before.degree_90);
    CHECK(turned.small_sources.share == Approx(before.small_sources.share).epsilon(0.02));
    CHECK(std::remainder(turned.small_sources.brightest->direction.longitude_degrees() -
                             before.small_sources.brightest->direction.longitude_degrees() - degrees,
                         360) == Approx(0).margin(0.1));
  }
  const EnvironmentAnalysis cloudless = relight::analyse(relight::clear_sky({.height = 128, .sun_to_sky = 0}));
  CHECK(cloudless.verdict == Verdict::kLinear);
  CHECK(cloudless.small_sources.share < 1e-3);
}

TEST_CASE("the more a map is blurred, the lower its degree, and the verdict goes from one end to the other") {
  const Environment sky = relight::clear_sky({.height = 128, .sun_to_sky = 4});
  int before = 50;
  std::vector<Verdict> verdicts;
  for (const double sigma : {0.02, 0.04, 0.07, 0.08, 0.09, 0.15, 0.4}) {
    const EnvironmentAnalysis analysis =
        relight::analyse(Environment(relight::filtered(sky.radiance(), relight::blur_weights(sigma))));
    CHECK(analysis.degree_90 < before);
    before = analysis.degree_90;
    verdicts.push_back(analysis.verdict);
  }
  CHECK(verdicts.front() == Verdict::kSuperResolution);
  CHECK(std::count(verdicts.begin(), verdicts.end(), Verdict::kEither) > 0);
  CHECK(verdicts.back() == Verdict::kLinear);
}

TEST_CASE("the degree that holds a share of the energy, and the verdicts' borders") {
  const std::vector<double> energy{4, 3, 2, 1, 0};
  CHECK(relight::degree_holding(energy, 0) == 0);
  CHECK(relight::degree_holding(energy, 0.4) == 0);
  CHECK(relight::degree_holding(energy, 0.41) == 1);
  CHECK(relight::degree_holding(energy, 0.9) == 2);
  CHECK(relight::degree_holding(energy, 0.95) == 3);
  CHECK(relight::degree_holding(energy, 1) == 3);
  CHECK(relight::degree_holding(std::vector<double>(51, 0.0), 0.9) == 0);
  CHECK(relight::degree_holding({}, 0.9) == 0);
  CHECK(relight::verdict_name(relight::verdict_of(0)) == "linear");
  CHECK(relight::verdict_name(relight::verdict_of(15)) == "linear");
  CHECK(relight::verdict_name(relight::verdict_of(16)) == "either");
  CHECK(relight::verdict_name(relight::verdict_of(19)) == "either");
  CHECK(relight::verdict_name(relight::verdict_of(20)) == "super_resolution");
}

TEST_CASE("an analysis is the same for every thread count") {
  const Environment sky = relight::clear_sky({.height = 150});
  core::set_thread_count(1);
  const EnvironmentAnalysis alone = relight::analyse(sky);
  core::set_thread_count(3);
  const EnvironmentAnalysis together = relight::analyse(sky);
  core::set_thread_count(0);
  CHECK(together.energy_by_degree == alone.energy_by_degree);
  CHECK(together.small_sources.share == alone.small_sources.share);
  CHECK(together.small_sources.brightest->direction == alone.small_sources.brightest->direction);
  CHECK(together.small_sources.brightest->diameter_degrees == alone.small_sources.brightest->diameter_degrees);
}

TEST_CASE("real environments: an overcast court is smooth, a low sun and lamps are not") {
  const auto folder = test::real_data("envmaps");
  if (folder.empty()) SKIP_TEST("no real environments here");
  const EnvironmentAnalysis court = relight::analyse(Environment::read(folder / "uffizi_probe.exr"));
  CHECK(court.verdict == Verdict::kLinear);
  CHECK(court.small_sources.share < 0.05);
  const EnvironmentAnalysis sunset = relight::analyse(Environment::read(folder / "venice_sunset_1k.hdr"));
  CHECK(sunset.verdict == Verdict::kSuperResolution);
  CHECK(sunset.share_above_50 > 0.5);
  CHECK(sunset.small_sources.brightest->diameter_degrees < 1);
}

}  // namespace lightstage
