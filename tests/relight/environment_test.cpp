// The environment map's conventions, and that none of its light is lost.
#include <catch2/catch.hpp>
#include <numbers>

#include "core/error.h"
#include "core/parallel.h"
#include "core/sphere.h"
#include "relight/environment.h"
#include "support/support.h"

namespace lightstage {

namespace {

using core::Direction;
using core::Image;
using core::Vec3;
using relight::DistantLight;
using relight::Environment;

constexpr double kPi = std::numbers::pi;

Image constant_map(int height, int width, float value) {
  Image map(height, width, 3);
  std::fill(map.values().begin(), map.values().end(), value);
  return map;
}

// Light of every size and colour, with dark regions and a sun.
Image rough_map(int height, int width) {
  Image map(height, width, 3);
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x)
      for (int c = 0; c < 3; ++c)
        map(y, x, c) = (y / 5 + x / 7) % 3 == 0 ? 0.0f : float(1.1 + std::sin(0.3 * x * (c + 1)) * std::cos(0.2 * y));
  map(height / 3, width / 5, 0) = 1e6f;
  return map;
}

// The map's whole light, row sums first, in long double.
Vec3 total_of(const Environment& map) {
  long double sum[3] = {0, 0, 0};
  for (int y = 0; y < map.height(); ++y)
    for (int x = 0; x < map.width(); ++x)
      for (int c = 0; c < 3; ++c)
        sum[c] +=
            static_cast<long double>(map.radiance()(y, x, c)) * map.solid_angle(y) / std::numbers::pi_v<long double>;
  return {double(sum[0]), double(sum[1]), double(sum[2])};
}

Vec3 total_of(const std::vector<DistantLight>& lights) {
  Vec3 sum;
  for (const DistantLight& light : lights) sum = sum + light.irradiance;
  return sum;
}

void require_same_energy(Vec3 a, Vec3 b, double relative = 1e-12) {
  CHECK(a.x == Approx(b.x).epsilon(relative));
  CHECK(a.y == Approx(b.y).epsilon(relative));
  CHECK(a.z == Approx(b.z).epsilon(relative));
}

bool same(const std::vector<DistantLight>& a, const std::vector<DistantLight>& b) {
  return std::equal(a.begin(), a.end(), b.begin(), b.end(), [](const DistantLight& p, const DistantLight& q) {
    return p.direction == q.direction && p.irradiance == q.irradiance;
  });
}

std::vector<Vec3> plain_gather(const Environment& map, const std::vector<Direction>& directions) {
  std::vector<Vec3> sums(directions.size());
  for (int y = 0; y < map.height(); ++y)
    for (int x = 0; x < map.width(); ++x) {
      const Vec3 pixel = map.direction(y, x).vec();
      std::size_t nearest = 0;
      for (std::size_t i = 1; i < directions.size(); ++i)
        if (core::dot(pixel, directions[i].vec()) > core::dot(pixel, directions[nearest].vec())) nearest = i;
      const float* p = map.radiance().pixel(y, x);
      sums[nearest] = sums[nearest] + (map.solid_angle(y) / kPi) * Vec3{p[0], p[1], p[2]};
    }
  return sums;
}

}  // namespace

TEST_CASE("the map's centre is +z, up is +y, +x a quarter of the width to the left, the seam -z") {
  // Odd sizes have a pixel centre exactly there.
  const Environment odd(Image(5, 9, 3));
  CHECK(odd.direction(2, 4) == Direction());
  const Environment map(Image(512, 1024, 3));
  const double half_pixel = kPi / 512;
  const auto near = [&](int y, int x, Vec3 v) {
    return core::angle_radians(map.direction(y, x), Direction::from_vector(v)) < 1.5 * half_pixel;
  };
  CHECK(near(256, 512, {0, 0, 1}));
  CHECK(near(256, 256, {1, 0, 0}));
  CHECK(near(256, 768, {-1, 0, 0}));
  CHECK(near(256, 0, {0, 0, -1}));
  CHECK(near(256, 1023, {0, 0, -1}));
  for (const int x : {0, 300, 1023}) {
    CHECK(near(0, x, {0, 1, 0}));
    CHECK(near(511, x, {0, -1, 0}));
  }
  // Longitude falls from left to right by one pixel's width each, latitude from top to bottom.
  CHECK(map.direction(100, 256).longitude_degrees() == Approx(90 - 360.0 / 2048).epsilon(1e-12));
  CHECK(map.direction(0, 3).latitude_degrees() == Approx(90 - 180.0 / 1024).epsilon(1e-12));
}

TEST_CASE("the solid angles of every map sum to 4 pi, and each is the area between its parallels and meridians") {
  for (const auto& [height, width] : {std::pair{1, 1}, {1, 2}, {2, 1}, {3, 7}, {512, 1024}, {8192, 2}}) {
    const Environment map(Image(height, width, 1));
    long double sum = 0;
    for (int y = 0; y < height; ++y) {
      sum += static_cast<long double>(map.solid_angle(y)) * width;
      const long double step = std::numbers::pi_v<long double> / height;
      const long double area =
          2 * std::numbers::pi_v<long double> / width * (std::cos(step * y) - std::cos(step * (y + 1)));
      REQUIRE(map.solid_angle(y) == Approx(double(area)).epsilon(1e-9));
      REQUIRE(map.solid_angle(y) == map.solid_angle(height - 1 - y));
    }
    CHECK(double(sum / (4 * std::numbers::pi_v<long double>)) == Approx(1).epsilon(1e-12));
  }
}

TEST_CASE("negative light counts as none and is counted; NaN and infinity are refused with their pixel") {
  Image map = constant_map(2, 4, 1);
  map(0, 1, 2) = -3e-6f;
  map(1, 3, 0) = -1;
  const Environment environment(map);
  CHECK(environment.negative_values() == 2);
  CHECK(environment.radiance()(0, 1, 2) == 0);
  CHECK(environment.radiance()(1, 3, 0) == 0);
  CHECK(environment.radiance()(1, 3, 1) == 1);
  map(1, 2, 1) = std::nanf("");
  CHECK_THROWS_AS(Environment(map), core::BadInput);
  CHECK_THROWS_WITH(Environment(map), Catch::Contains("x 2, y 1"));
  map(1, 2, 1) = INFINITY;
  CHECK_THROWS_AS(Environment(map), core::BadInput);
  CHECK_THROWS_AS(Environment(Image()), core::BadInput);
}

TEST_CASE("a grey map shines white, alpha is dropped") {
  Image grey(1, 2, 1);
  grey(0, 1) = 0.5f;
  CHECK(Environment(grey).radiance()(0, 1, 2) == 0.5f);
  Image rgba = Image(1, 2, 4);
  rgba(0, 0, 3) = 7;
  rgba(0, 0, 1) = 2;
  const Environment environment(rgba);
  CHECK(environment.radiance().size() == core::ImageSize{1, 2, 3});
  CHECK(environment.radiance()(0, 0, 1) == 2);
}

TEST_CASE("a map turned by whole turns is bit-equal, by whole pixels exact and back again") {
  for (const auto& [height, width] : {std::pair{1, 1}, {3, 7}, {8, 100}, {64, 128}}) {
    const Environment map(rough_map(height, width));
    for (const double degrees : {0.0, 360.0, -360.0, 720.0, 3.6e9})
      CHECK(map.rotated(degrees).radiance() == map.radiance());
    for (const double degrees : {0.1, 33.3, -179.9})
      for (const double turns : {360.0, -720.0, 3600.0})
        CHECK(map.rotated(degrees + turns).radiance() == map.rotated(degrees).radiance());
    for (const int pixels : {1, width / 3, -width / 2}) {
      const double degrees = 360.0 * pixels / width;
      const Environment turned = map.rotated(degrees);
      for (int y = 0; y < height; ++y)
        for (int x = 0; x < width; ++x)
          REQUIRE(turned.radiance()(y, x, 1) == map.radiance()(y, ((x + pixels) % width + width) % width, 1));
      CHECK(turned.rotated(-degrees).radiance() == map.radiance());
    }
  }
}

TEST_CASE("turning by +90 degrees brings the light of +z to +x, and a part of a pixel is linear and keeps the energy") {
  Image map(4, 8, 3);
  map(1, 3, 0) = 8;  // half a pixel left of the centre: longitude 22.5
  const Environment environment(map);
  CHECK(environment.direction(1, 3).longitude_degrees() == Approx(22.5));
  const Environment turned = environment.rotated(90);
  CHECK(turned.radiance()(1, 1, 0) == 8);
  CHECK(turned.direction(1, 1).longitude_degrees() == Approx(112.5));
  const Environment part = environment.rotated(45.0 / 4);
  CHECK(part.radiance()(1, 3, 0) == Approx(6));
  CHECK(part.radiance()(1, 2, 0) == Approx(2));
  const Environment rough(rough_map(31, 64));
  for (const double degrees : {0.1, 77.7, -179.9, 1234.5})
    require_same_energy(total_of(rough.rotated(degrees)), total_of(rough), 1e-6);
  CHECK_THROWS_AS(environment.rotated(std::nan("")), core::UsageError);
  CHECK_THROWS_AS(environment.rotated(INFINITY), core::UsageError);
}

TEST_CASE("a resized map keeps its light, and is the plain mean over what each pixel covers") {
  for (const auto& [height, width] : {std::pair{1, 1}, {1, 2}, {3, 7}, {31, 64}, {128, 256}}) {
    const Environment map(rough_map(height, width));
    CHECK(map.resized(width, height).radiance() == map.radiance());
    for (const auto& [to_height, to_width] :
         {std::pair{1, 1}, {1, 2}, {2, 1}, {5, 9}, {32, 64}, {30, 65}, {257, 500}}) {
      CAPTURE(height, width, to_height, to_width);
      const Environment other = map.resized(to_width, to_height);
      CHECK(other.radiance().size() == core::ImageSize{to_height, to_width, 3});
      require_same_energy(total_of(other), total_of(map), 1e-7);
    }
  }
  // Whole blocks of pixels become one, weighted by their solid angles; a pixel becomes a block of its own value.
  const Environment fine(rough_map(12, 30));
  const Environment coarse = fine.resized(10, 4);
  for (int y = 0; y < 4; ++y)
    for (int x = 0; x < 10; ++x) {
      double sum = 0, area = 0;
      for (int i = 3 * y; i < 3 * y + 3; ++i)
        for (int j = 3 * x; j < 3 * x + 3; ++j) {
          sum += fine.radiance()(i, j, 1) * fine.solid_angle(i);
          area += fine.solid_angle(i);
        }
      CHECK(coarse.radiance()(y, x, 1) == Approx(sum / area).epsilon(1e-6));
    }
  const Environment back = coarse.resized(30, 12);
  for (int y = 0; y < 12; ++y)
    for (int x = 0; x < 30; ++x) CHECK(back.radiance()(y, x, 2) == coarse.radiance()(y / 3, x / 3, 2));
  CHECK_THROWS_AS(fine.resized(0, 4), core::UsageError);
  CHECK_THROWS_AS(fine.resized(4, -1), core::UsageError);
}

TEST_CASE("resized maps keep a sun where it is, a constant constant, and count what was negative") {
  const Environment sky(constant_map(61, 122, 0.3f));
  for (const auto& [height, width] : {std::pair{7, 5}, {64, 128}, {500, 333}})
    CHECK(sky.resized(width, height).radiance() == constant_map(height, width, 0.3f));
  Image image(64, 128, 3);
  image(20, 127, 0) = 1e6f;  // at the seam
  image(0, 0, 0) = -1;
  const Environment map(image);
  const Environment small = map.resized(37, 19);
  CHECK(small.negative_values() == 1);
  CHECK(core::angle_radians(small.lights(100)[0].direction, map.direction(20, 127)) < kPi / 19);
  core::set_thread_count(1);
  const Image alone = Environment(rough_map(211, 419)).resized(100, 77).radiance();
  core::set_thread_count(3);
  CHECK(Environment(rough_map(211, 419)).resized(100, 77).radiance() == alone);
  core::set_thread_count(0);
}

TEST_CASE("gathering gives every pixel to the nearest direction, as comparing with all of them does") {
  std::vector<std::vector<Direction>> sets{core::fibonacci_directions(1),
                                           core::fibonacci_directions(2),
                                           core::fibonacci_directions(57),
                                           core::random_directions(300, 3),
                                           {Direction(), Direction(), Direction::from_vector({0, 1, 0})}};
  sets.push_back({Direction::from_vector({1e-3, 0, 1}), Direction::from_vector({-1e-3, 0, 1}),
                  Direction::from_vector({0, 1, 1e-4}), Direction::from_vector({0, -1, 1e-9})});
  for (const auto& [height, width] : {std::pair{1, 1}, {1, 2}, {2, 1}, {17, 33}, {61, 131}, {128, 256}}) {
    const Environment map(rough_map(height, width));
    for (const auto& directions : sets) {
      CAPTURE(height, width, directions.size());
      const std::vector<Vec3> plain = plain_gather(map, directions);
      const std::vector<DistantLight> fast = map.gather(directions);
      REQUIRE(fast.size() == directions.size());
      for (std::size_t i = 0; i < plain.size(); ++i) {
        REQUIRE(fast[i].irradiance.x == Approx(plain[i].x).epsilon(1e-9).margin(1e-12));
        REQUIRE(fast[i].irradiance.y == Approx(plain[i].y).epsilon(1e-9).margin(1e-12));
        REQUIRE(fast[i].irradiance.z == Approx(plain[i].z).epsilon(1e-9).margin(1e-12));
      }
      require_same_energy(total_of(fast), total_of(map));
    }
  }
  CHECK_THROWS_AS(Environment(Image(1, 2, 3)).gather({}), core::UsageError);
}

TEST_CASE("lights taken in boxes keep all energy, and single pixels where boxes are smaller") {
  const Environment map(rough_map(45, 91));
  for (const double box : {0.0, 0.01, 0.08, 0.3, 2.0, 100.0})
    require_same_energy(total_of(map.lights(box)), total_of(map));
  std::size_t lit = 0;
  for (int y = 0; y < 45; ++y)
    for (int x = 0; x < 91; ++x)
      lit += map.radiance()(y, x, 0) > 0 || map.radiance()(y, x, 1) > 0 || map.radiance()(y, x, 2) > 0 ? 1 : 0;
  const std::vector<DistantLight> pixels = map.lights(0);
  CHECK(pixels.size() == lit);
  const Environment one_lit([] {
    Image image(45, 91, 3);
    image(7, 80, 1) = 3;
    return image;
  }());
  const std::vector<DistantLight> one = one_lit.lights(0.2);
  REQUIRE(one.size() == 1);
  CHECK(core::angle_radians(one[0].direction, one_lit.direction(7, 80)) < 1e-12);
  CHECK(one[0].irradiance.x == 0);
  CHECK(one[0].irradiance.y == Approx(3 * one_lit.solid_angle(7) / kPi).epsilon(1e-14));
  CHECK_THROWS_AS(map.lights(-1), core::UsageError);
  CHECK_THROWS_AS(map.lights(std::nan("")), core::UsageError);
}

TEST_CASE("a one-pixel sun a million times brighter than the sky stays where it is") {
  Image image = constant_map(128, 256, 1);
  for (int c = 0; c < 3; ++c) image(40, 100, c) = 1e6f;
  const Environment map(image);
  const auto brightest = [](const std::vector<DistantLight>& lights) {
    return *std::max_element(lights.begin(), lights.end(), [](const DistantLight& a, const DistantLight& b) {
      return a.irradiance.y < b.irradiance.y;
    });
  };
  const double pixel = kPi / 128;
  for (const DistantLight& sun : {brightest(map.gather(core::fibonacci_directions(200))), brightest(map.lights(0.2))}) {
    CHECK(core::angle_radians(sun.direction, map.direction(40, 100)) < 0.01 * pixel);
    CHECK(sun.irradiance.y == Approx(1e6 * map.solid_angle(40) / kPi).epsilon(1e-3));
  }
}

TEST_CASE("a constant sky has an irradiance of four, equally from everywhere; a black map has no lights") {
  const Environment sky(constant_map(256, 512, 1));
  const std::vector<Direction> directions = core::fibonacci_directions(100);
  for (const DistantLight& light : sky.gather(directions)) CHECK(light.irradiance.x == Approx(0.04).epsilon(0.08));
  CHECK(total_of(sky.lights(0.1)).x == Approx(4).epsilon(1e-12));
  // Evenly from all sides: the one direction that gathers everything stays where it was.
  const std::vector<Direction> one{Direction::from_vector({1, 2, 3})};
  CHECK(sky.gather(one)[0].direction == one[0]);

  const Environment black(Image(8, 16, 3));
  CHECK(black.lights(0.1).empty());
  const std::vector<DistantLight> dark = black.gather(directions);
  for (std::size_t i = 0; i < directions.size(); ++i) {
    CHECK(dark[i].direction == directions[i]);
    CHECK(dark[i].irradiance == Vec3{});
  }
}

TEST_CASE("gathered lights are bit-equal for every thread count") {
  const Environment map(rough_map(211, 419));
  const std::vector<Direction> directions = core::fibonacci_directions(90);
  core::set_thread_count(1);
  const auto gathered = map.gather(directions);
  const auto boxes = map.lights(0.07);
  const Image turned = map.rotated(12.3).radiance();
  for (const int threads : {2, 3, 8}) {
    core::set_thread_count(threads);
    CHECK(same(map.gather(directions), gathered));
    CHECK(same(map.lights(0.07), boxes));
    CHECK(map.rotated(12.3).radiance() == turned);
  }
  core::set_thread_count(0);
}

TEST_CASE("a map of 8192 x 4096 pixels loses nothing") {
  Image image(4096, 8192, 1);
  std::fill(image.values().begin(), image.values().end(), 0.5f);
  image(0, 0) = 1e6f;
  const Environment map(image);
  const double light = 2 + (1e6 - 0.5) * map.solid_angle(0) / kPi;
  const Vec3 expected{light, light, light};
  require_same_energy(total_of(map.gather(core::fibonacci_directions(512))), expected, 1e-11);
  require_same_energy(total_of(map.lights(0.02)), expected, 1e-11);
}

TEST_CASE("real environments are read, keep their energy, and have few negative values if any") {
  const auto folder = test::real_data("envmaps");
  if (folder.empty()) SKIP_TEST("no real environments here");
  for (const char* name : {"venice_sunset_1k.hdr", "studio_small_09_1k.hdr", "uffizi_probe.exr", "corridor.exr"}) {
    CAPTURE(name);
    const Environment map = Environment::read(folder / name);
    CHECK(map.width() == 2 * map.height());
    CHECK(map.negative_values() < 1000);
    const Vec3 total = total_of(map);
    CHECK(total.y > 0);
    require_same_energy(total_of(map.gather(core::fibonacci_directions(300))), total, 1e-10);
    require_same_energy(total_of(map.lights(0.03)), total, 1e-10);
  }
  CHECK_THROWS_WITH(Environment::read(folder / "absent.exr"), Catch::Contains("absent.exr"));
}

}  // namespace lightstage
