// Normals and albedo from shading, where they are known.
#include "model/normals.h"

#include <catch2/catch.hpp>
#include <csignal>
#include <numbers>

#include "core/error.h"
#include "core/interrupt.h"
#include "core/parallel.h"
#include "core/sphere.h"
#include "model/synthetic_scan.h"
#include "support/support.h"

namespace lightstage {

namespace {

using core::Direction;
using core::Image;
using core::Vec3;

constexpr int kSide = 48;
constexpr core::ImageSize kSize{kSide, kSide, 3};

// The normal of a ball that fills a picture of this side, seen from +z from afar; zero beside it.
Vec3 ball_normal(int y, int x, int side = kSide) {
  const double nx = (2.0 * x + 1 - side) / side, ny = (side - 2.0 * y - 1) / side, r2 = nx * nx + ny * ny;
  return r2 < 1 ? Vec3{nx, ny, std::sqrt(1 - r2)} : Vec3{};
}

// GGX with Smith's masking and Schlick's Fresnel, as the simulator shades (sim/render/shading.h), times pi.
double ggx(Vec3 n, Vec3 l, double roughness, double f0) {
  const Vec3 v{0, 0, 1};
  const double nl = dot(n, l), nv = dot(n, v);
  if (nl <= 0 || nv <= 0) return 0;
  const Vec3 sum = l + v;
  const double length = norm(sum);
  if (length == 0) return 0;
  const Vec3 h = sum / length;
  const double a2 = std::pow(roughness, 4), nh = dot(n, h), hv = dot(h, v);
  const double d = a2 / (std::numbers::pi * std::pow(nh * nh * (a2 - 1) + 1, 2));
  const double masking = 0.5 / (nl * std::sqrt(a2 + (1 - a2) * nv * nv) + nv * std::sqrt(a2 + (1 - a2) * nl * nl));
  return std::numbers::pi * d * masking * (f0 + (1 - f0) * std::pow(1 - hv, 5));
}

test::PixelFunction matte_ball() {
  return [](const Direction& light, int y, int x, int c) {
    return (0.8 - 0.2 * c) * std::max(0.0, dot(ball_normal(y, x), light.vec()));
  };
}

test::PixelFunction glossy_ball(double roughness, double f0) {
  return [=](const Direction& light, int y, int x, int c) {
    const Vec3 n = ball_normal(y, x);
    const double cosine = std::max(0.0, dot(n, light.vec()));
    return cosine * ((0.6 - 0.15 * c) + ggx(n, light.vec(), roughness, f0));
  };
}

// Angles in degrees between estimated and true normals on the ball, in ascending order.
std::vector<double> normal_errors(const model::SurfaceMaps& maps) {
  std::vector<double> errors;
  for (int y = 0; y < kSide; ++y) {
    for (int x = 0; x < kSide; ++x) {
      const Vec3 truth = ball_normal(y, x);
      if (norm(truth) == 0) continue;
      const Vec3 n{maps.normals(y, x, 0), maps.normals(y, x, 1), maps.normals(y, x, 2)};
      errors.push_back(core::degrees_from_radians(2 * std::atan2(norm(n - truth), norm(n + truth))));
    }
  }
  std::sort(errors.begin(), errors.end());
  return errors;
}

double at(const std::vector<double>& sorted, double share) {
  return sorted[std::size_t(share * double(sorted.size() - 1))];
}

class ThreadCount {
 public:
  explicit ThreadCount(int n) { core::set_thread_count(n); }
  ~ThreadCount() { core::set_thread_count(0); }
};

}  // namespace

TEST_CASE("normals: a matte ball's are found, with its albedo, though half of the lights stand behind every pixel") {
  const model::SurfaceMaps maps =
      model::estimate_normals(test::scan_of(core::fibonacci_directions(302), kSize, matte_ball()));
  const std::vector<double> errors = normal_errors(maps);
  CHECK(at(errors, 0.95) < 0.001);
  CHECK(errors.back() < 0.01);
  for (int c = 0; c < 3; ++c) CHECK(maps.albedo(20, 30, c) == Approx(0.8 - 0.2 * c).epsilon(1e-4));
  CHECK(maps.confidence(20, 30) > 0.5);
}

TEST_CASE("normals: highlights on a glossy ball do not bend them") {
  for (const auto& [roughness, f0] : {std::pair{0.2, 0.04}, {0.5, 0.04}, {0.3, 0.3}}) {
    CAPTURE(roughness, f0);
    const std::vector<double> errors = normal_errors(
        model::estimate_normals(test::scan_of(core::fibonacci_directions(302), kSize, glossy_ball(roughness, f0))));
    CHECK(at(errors, 0.5) < 1);
    CHECK(errors.back() < 2);
  }
}

TEST_CASE("normals: a ball under the lights of a frontal dome, with noise, hot pixels and a cast shadow") {
  std::vector<Direction> lights;
  for (const Direction& d : core::fibonacci_directions(200))
    if (d.z() > 0.3) lights.push_back(d);
  // Noise from a hash of the place and the light, uniform in +-0.02; a shadow that a third of the lights cast.
  const auto value = [ball = matte_ball()](const Direction& light, int y, int x, int c) {
    const double noise = std::fmod(
        std::abs(std::sin(12.9898 * x + 78.233 * y + 37.7 * c + 911 * light.x() + 357 * light.y())) * 43758.5453, 1);
    if (light.x() > 0.3 && x > 24) return 0.0;
    if (light.y() > 0.95 && x % 5 == 0) return 1e5;
    return ball(light, y, x, c) + 0.04 * (noise - 0.5);
  };
  const std::vector<double> errors = normal_errors(model::estimate_normals(test::scan_of(lights, kSize, value)));
  CHECK(at(errors, 0.5) < 0.7);
  CHECK(at(errors, 0.95) < 3);
}

TEST_CASE("normals: a pixel in a fold, that one light in seven reaches, is judged by those") {
  const Vec3 n = Direction::from_vector({0.1, 0.2, 0.9}).vec();
  const std::vector<Direction> lights = core::fibonacci_directions(302);
  const auto reaches = [](const Direction& light) { return light.x() < -0.47 && light.z() > 0; };
  CHECK(std::count_if(lights.begin(), lights.end(), reaches) < 302 / 7 + 1);
  const auto fold = [&](const Direction& light, int, int, int) {
    return std::max(0.0, dot(n, light.vec())) * (reaches(light) ? 0.7 : 0.03);
  };
  const model::SurfaceMaps maps = model::estimate_normals(test::scan_of(lights, {1, 1, 3}, fold));
  const Vec3 found{maps.normals(0, 0, 0), maps.normals(0, 0, 1), maps.normals(0, 0, 2)};
  CHECK(core::degrees_from_radians(2 * std::atan2(norm(found - n), norm(found + n))) < 0.1);
  CHECK(maps.albedo(0, 0) == Approx(0.7).epsilon(0.01));
}

TEST_CASE("normals: the same for every thread count, and finite and unit whatever the pictures") {
  const std::vector<Direction> lights = core::fibonacci_directions(60);
  const auto extreme = [](const Direction& light, int y, int x, int c) {
    switch ((y * 48 + x) % 7) {
      case 0:
        return 0.0;
      case 1:
        return 65504.0;
      case 2:
        return 1e-40 * (1 + light.x());
      case 3:
        return light.y() > 0.9 ? 1e5 : 0.01;
      case 4:
        return -0.5 * light.z();
      case 5:
        return c == 1 ? 3e38 * light.z() : 0.0;
      default:
        return std::max(0.0, light.x());
    }
  };
  const core::OlatScan scan = test::scan_of(lights, {5, 9, 3}, extreme);
  const model::SurfaceMaps maps = model::estimate_normals(scan);
  for (const int threads : {1, 2, 7}) {
    const ThreadCount with(threads);
    const model::SurfaceMaps again = model::estimate_normals(scan);
    CHECK(again.normals == maps.normals);
    CHECK(again.albedo == maps.albedo);
    CHECK(again.confidence == maps.confidence);
    CHECK(again.condition == maps.condition);
  }
  for (int y = 0; y < 5; ++y) {
    for (int x = 0; x < 9; ++x) {
      CAPTURE(y, x);
      const Vec3 n{maps.normals(y, x, 0), maps.normals(y, x, 1), maps.normals(y, x, 2)};
      CHECK(norm(n) == Approx(1).margin(1e-6));
      for (int c = 0; c < 3; ++c) CHECK((maps.albedo(y, x, c) >= 0 && std::isfinite(maps.albedo(y, x, c))));
      CHECK((maps.confidence(y, x) >= 0 && maps.confidence(y, x) <= 1));
      CHECK((maps.condition(y, x) >= 1 && maps.condition(y, x) <= 1e6F));
    }
  }
  CHECK(maps.normals(0, 0, 2) == 1);
  CHECK(maps.albedo(0, 0, 1) == 0);
  CHECK(maps.confidence(0, 0) == 0);
}

TEST_CASE("normals: Ctrl-C ends the fitting") {
  const core::OlatScan scan = test::scan_of(core::fibonacci_directions(6), {3, 3, 1},
                                            [](const Direction& light, int, int, int) { return light.z(); });
  {
    const core::InterruptGuard guard;
    std::raise(SIGINT);
    CHECK_THROWS_AS(model::estimate_normals(scan), core::Interrupted);
  }
  const core::InterruptGuard forgotten;
  CHECK_NOTHROW(model::estimate_normals(scan));
}

TEST_CASE("normals: few lights say what they can, and the condition number says how much that is") {
  const Vec3 n = Direction::from_vector({0.3, 0.2, 0.9}).vec();
  const auto matte = [n](const Direction& light, int, int, int) { return 0.5 * std::max(0.0, dot(n, light.vec())); };
  const auto maps_of = [&](const std::vector<Direction>& lights) {
    return model::estimate_normals(test::scan_of(lights, {1, 1, 3}, matte));
  };
  const auto normal_of = [](const model::SurfaceMaps& maps) {
    return Vec3{maps.normals(0, 0, 0), maps.normals(0, 0, 1), maps.normals(0, 0, 2)};
  };
  const Direction a = Direction::from_vector({0, 0, 1}), b = Direction::from_vector({0.8, 0, 0.6}),
                  c = Direction::from_vector({0, 0.6, 0.8}), behind = Direction::from_vector({0, 0, -1});

  const model::SurfaceMaps one = maps_of({a});
  CHECK(dot(normal_of(one), a.vec()) == Approx(1));
  CHECK(one.albedo(0, 0, 0) == Approx(0.5 * dot(n, a.vec())));
  CHECK(one.condition(0, 0) == 1e6F);

  // Two lights leave the part across their plane open; it is none.
  const model::SurfaceMaps two = maps_of({a, b, behind});
  CHECK(two.condition(0, 0) == 1e6F);
  CHECK(two.normals(0, 0, 1) == Approx(0).margin(1e-6));
  CHECK(two.normals(0, 0, 0) / two.normals(0, 0, 2) == Approx(n.x / n.z).epsilon(1e-3));

  const model::SurfaceMaps three = maps_of({a, b, c, behind});
  CHECK(dot(normal_of(three), n) == Approx(1).margin(1e-6));
  CHECK(three.albedo(0, 0, 2) == Approx(0.5).epsilon(1e-3));
  CHECK(three.condition(0, 0) > 1);
  CHECK(three.condition(0, 0) < 10);

  // Equal lights are one light; lights a degree apart are nearly so.
  CHECK(maps_of({a, a, a}).condition(0, 0) == 1e6F);
  const auto close = maps_of({a, Direction::from_vector({0.0175, 0, 1}), Direction::from_vector({0, 0.0175, 1})});
  CHECK(close.condition(0, 0) > 30);
  CHECK(close.condition(0, 0) < 1e6F);
}

}  // namespace lightstage
