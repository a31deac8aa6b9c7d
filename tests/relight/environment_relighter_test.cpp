// What the planner saves, against the exhaustive answer.
#include <catch2/catch.hpp>
#include <cmath>
#include <numbers>

#include "core/error.h"
#include "core/parallel.h"
#include "model/evaluation.h"
#include "model/methods.h"
#include "model/metrics.h"
#include "model/picture_sum.h"
#include "relight/environment_relighter.h"
#include "relight/known_subject.h"
#include "relight/picture.h"
#include "relight/relight.h"
#include "relight/sky.h"
#include "support/support.h"

namespace lightstage {

namespace {

using core::Image;
using core::Vec3;
using relight::Environment;
using relight::EnvironmentRelighter;
using relight::EnvironmentReport;
using relight::ErrorGoal;
using relight::ErrorMeasure;
using test::KnownSubject;

constexpr core::ImageSize kSize{40, 41, 3};

const KnownSubject& subject() {
  static const KnownSubject known(200, kSize, test::shiny_ball(kSize));
  return known;
}

const EnvironmentRelighter& relighter() {
  static const EnvironmentRelighter made(subject());
  return made;
}

Environment constant_map(float value, int height = 32) {
  Image map(height, 2 * height, 3);
  std::fill(map.values().begin(), map.values().end(), value);
  return Environment(map);
}

// Light that is a polynomial of degree 2 in the direction.
Environment smooth_map() {
  Image map(32, 64, 3);
  const Environment places(map);
  for (int y = 0; y < 32; ++y)
    for (int x = 0; x < 64; ++x) {
      const core::Direction d = places.direction(y, x);
      map(y, x, 0) = float(1 + 0.6 * d.y() + 0.3 * d.x() * d.z());
      map(y, x, 1) = float(1 + 0.5 * d.y());
      map(y, x, 2) = float(1 + 0.4 * d.y() - 0.3 * d.x());
    }
  return Environment(map);
}

// A dim room with two windows and a lamp.
Environment room_map() {
  Image map(32, 64, 3);
  for (float& v : map.values()) v = 0.05F;
  const auto paint = [&](int top, int bottom, int left, int right, float value) {
    for (int y = top; y < bottom; ++y)
      for (int x = left; x < right; ++x)
        for (int c = 0; c < 3; ++c) map(y, x, c) = value * (1 - 0.1F * float(c));
  };
  paint(10, 16, 12, 17, 6);
  paint(9, 15, 40, 43, 9);
  paint(6, 7, 28, 29, 150);
  return Environment(map);
}

struct Errors {
  double dssim = 0, relative_rms = 0;
};

Errors errors(const Image& picture, const Image& truth, const Image& mask) {
  Image difference = picture;
  for (std::size_t i = 0; i < difference.values().size(); ++i) difference.values()[i] -= truth.values()[i];
  const double exposure = std::exp2(-relight::auto_exposure_stops(truth, mask));
  return {model::dssim(model::judged(picture, exposure, false), model::judged(truth, exposure, false), mask),
          relight::masked_rms(difference, mask) / relight::masked_rms(truth, mask)};
}

Image exhaustive(const Environment& map) {
  return relighter().relight(map, relight::Exhaustive{}).image;
}

double largest(const Image& image) {
  return double(*std::max_element(image.values().begin(), image.values().end()));
}

double largest_difference(const Image& a, const Image& b) {
  REQUIRE(a.size() == b.size());
  double most = 0;
  for (std::size_t i = 0; i < a.values().size(); ++i)
    most = std::max(most, std::abs(double(a.values()[i]) - double(b.values()[i])));
  return most;
}

}  // namespace

TEST_CASE("where a plan would take as many pictures as the map has lit pixels, plan and answer are exhaustive",
          "[planner]") {
  Image map(4, 8, 3);
  map(1, 2, 0) = 2;
  map(2, 7, 1) = 1;
  const Environment environment(map);
  const ErrorGoal goal{1e-7};
  const relight::Plan plan = relighter().plan(environment, goal);
  CHECK(plan.synthesised.size() == 2);
  CHECK(plan.remainder.empty());
  CHECK(plan.expected_error(ErrorMeasure::kDssim) == 0);
  const EnvironmentReport report = relighter().relight(environment, goal);
  CHECK(report.directions_synthesised == 2);
  CHECK(report.dssim_estimate == 0);
  CHECK(largest_difference(report.image, exhaustive(environment)) == 0);
}

TEST_CASE("the exhaustive answer is every lit pixel's picture times its light", "[planner]") {
  Image map(4, 8, 3);
  map(1, 2, 0) = 2;
  map(3, 7, 1) = 1;
  const Environment environment(map);
  const EnvironmentReport report = relighter().relight(environment, relight::Exhaustive{});
  CHECK(report.directions_exhaustive == 2);
  CHECK(report.directions_synthesised == 2);
  const Image first = subject().render(environment.direction(1, 2)),
              second = subject().render(environment.direction(3, 7));
  for (int y = 0; y < kSize.height; ++y)
    for (int x = 0; x < kSize.width; ++x) {
      const double pi = std::numbers::pi;
      CHECK(double(report.image(y, x, 0)) ==
            Approx(2 * environment.solid_angle(1) / pi * double(first(y, x, 0))).margin(1e-7));
      CHECK(double(report.image(y, x, 1)) ==
            Approx(environment.solid_angle(3) / pi * double(second(y, x, 1))).margin(1e-7));
      CHECK(report.image(y, x, 2) == 0);
    }
}

TEST_CASE("asked errors are kept, with few pictures, and what is estimated is near what is reached", "[planner]") {
  for (const auto& [name, map] :
       {std::pair("room", room_map()), std::pair("sky", relight::clear_sky({.height = 32}))}) {
    const Image truth = exhaustive(map);
    std::size_t before = 0;
    for (const double asked : {0.02, 0.005, 0.001}) {
      for (const ErrorMeasure measure : {ErrorMeasure::kDssim, ErrorMeasure::kRelativeRms}) {
        const double error = measure == ErrorMeasure::kDssim ? asked : std::sqrt(asked);
        const EnvironmentReport report = relighter().relight(map, ErrorGoal{error, measure});
        const Errors reached = errors(report.image, truth, subject().scan().mask());
        INFO(name << ", asked " << error << ", " << report.directions_synthesised << " pictures, DSSIM "
                  << reached.dssim << " (estimate " << report.dssim_estimate << "), relative " << reached.relative_rms
                  << " (estimate " << report.rms_estimate << ")");
        const bool is_dssim = measure == ErrorMeasure::kDssim;
        CHECK((is_dssim ? reached.dssim : reached.relative_rms) <= error);
        CHECK((is_dssim ? report.dssim_estimate : report.rms_estimate) <= error);
        CHECK(reached.relative_rms <= 1.5 * report.rms_estimate + 1e-6);
        CHECK(report.directions_synthesised * 5 < report.directions_exhaustive);
        if (is_dssim) {
          CHECK(report.directions_synthesised >= before);
          before = report.directions_synthesised;
        }
      }
    }
    CHECK(before > 0);
  }
}

TEST_CASE("smooth maps need no synthesis", "[planner]") {
  for (const Environment& map : {smooth_map(), constant_map(3)}) {
    const EnvironmentReport report = relighter().relight(map, ErrorGoal{});
    const Errors reached = errors(report.image, exhaustive(map), subject().scan().mask());
    INFO("estimate " << report.dssim_estimate << ", reached " << reached.dssim);
    CHECK(report.directions_synthesised == 0);
    CHECK(report.directions_captured == subject().scan().light_count());
    CHECK(reached.dssim < 0.002);
  }
}

TEST_CASE("a constant map's picture is the sum of the captured ones times their solid angles, which sum to the sphere",
          "[planner]") {
  const core::OlatScan& scan = subject().scan();
  const Environment map = constant_map(2.5F);
  const auto check_sum = [&](const model::LightInterpolator& carrier, const Image& picture) {
    std::vector<Vec3> solid_angles = carrier.captured_colours(constant_map(1).lights(0));
    double sum = 0;
    for (Vec3& colour : solid_angles) {
      sum += colour.x * std::numbers::pi;
      colour = 2.5 * colour;
    }
    CHECK(sum == Approx(4 * std::numbers::pi).epsilon(1e-4));
    model::PictureSum expected(kSize);
    expected.add(scan, solid_angles);
    const Image by_solid_angle = expected.result();
    CHECK(largest_difference(picture, by_solid_angle) < 1e-3 * largest(by_solid_angle));
  };
  model::MethodOptions options;
  options.domain = model::Domain::kLinear;
  for (const char* name : {"nearest", "linear", "barycentric", "rbf", "bspline"}) {
    const auto method = model::make_interpolator(name, scan, options);
    check_sum(*method, EnvironmentRelighter(*method).relight(map, ErrorGoal{}).image);
  }
  check_sum(*model::make_interpolator("rbf", scan, options), relighter().relight(map, ErrorGoal{}).image);
}

TEST_CASE("a subject that looks the same under every light keeps all energy, whatever the plan", "[planner]") {
  const KnownSubject flat(60, {6, 7, 3}, [](const core::Direction&, int, int, int c) { return 0.25 * (c + 1); });
  const EnvironmentRelighter relight_flat(flat);
  const Environment map = room_map();
  Vec3 energy;
  for (const relight::DistantLight& light : map.lights(0)) energy = energy + light.irradiance;
  for (const relight::Goal& goal : {relight::Goal(ErrorGoal{1e-6}), relight::Goal(ErrorGoal{}),
                                    relight::Goal(relight::TimeGoal{0.5}), relight::Goal(relight::Exhaustive{})}) {
    const Image picture = relight_flat.relight(map, goal).image;
    CHECK(double(picture(3, 3, 0)) == Approx(0.25 * energy.x).epsilon(1e-4));
    CHECK(double(picture(5, 6, 1)) == Approx(0.5 * energy.y).epsilon(1e-4));
    CHECK(double(picture(0, 0, 2)) == Approx(0.75 * energy.z).epsilon(1e-4));
  }
}

TEST_CASE("a small sun comes out as one light at its place", "[planner]") {
  Image map(64, 128, 3);
  for (float& v : map.values()) v = 1e-3F;
  for (int c = 0; c < 3; ++c) map(20, 50, c) = 1e6F;
  const Environment environment(map);
  const EnvironmentReport report = relighter().relight(environment, ErrorGoal{});
  CHECK(report.directions_synthesised <= 3);
  REQUIRE_FALSE(report.plan.synthesised.empty());
  CHECK(core::degrees_from_radians(
            core::angle_radians(report.plan.synthesised[0].direction, environment.direction(20, 50))) < 0.01);
  Image sun = subject().render(environment.direction(20, 50));
  const double irradiance = 1e6 * environment.solid_angle(20) / std::numbers::pi;
  for (float& v : sun.values()) v = float(double(v) * irradiance);
  CHECK(errors(report.image, sun, {}).relative_rms < 1e-4);
}

TEST_CASE("maps without light give black at once; extremes give finite pictures", "[planner]") {
  const EnvironmentReport dark = relighter().relight(constant_map(0), ErrorGoal{});
  CHECK(dark.directions_synthesised == 0);
  CHECK(dark.directions_exhaustive == 0);
  CHECK(largest(dark.image) == 0);
  Image half(16, 32, 3);
  for (int y = 0; y < 16; ++y)
    for (int x = 0; x < 16; ++x) half(y, x, 1) = 1;
  Image tiny(1, 2, 3);
  tiny(0, 1, 2) = 4;
  Image poles(16, 32, 3);
  for (int x = 0; x < 32; ++x) poles(0, x, 0) = poles(15, x, 2) = 50;
  Image bright(16, 32, 3);
  bright(8, 0, 0) = 3e38F;
  for (const Image& map : {half, tiny, poles, bright}) {
    const Environment environment(map);
    const Image picture = relighter().relight(environment, ErrorGoal{0.001}).image;
    for (const float v : picture.values()) REQUIRE(std::isfinite(v));
    const Errors reached = errors(picture, exhaustive(environment), {});
    INFO(map.width() << " x " << map.height() << ", reached " << reached.dssim);
    CHECK(reached.dssim < 0.002);
  }
}

TEST_CASE("more time gives more pictures and a smaller error; a little time is kept", "[planner]") {
  const Environment map = room_map();
  const Image truth = exhaustive(map);
  const EnvironmentReport little = relighter().relight(map, relight::TimeGoal{1e-3});
  const EnvironmentReport more = relighter().relight(map, relight::TimeGoal{3});
  CHECK(little.directions_synthesised <= 2);
  CHECK(more.directions_synthesised > 20);
  CHECK(more.rms_estimate < little.rms_estimate);
  CHECK(errors(more.image, truth, {}).relative_rms < errors(little.image, truth, {}).relative_rms);
}

TEST_CASE("planned pictures do not depend on the number of threads", "[planner]") {
  core::set_thread_count(1);
  const Image one = relighter().relight(room_map(), ErrorGoal{0.001}).image;
  core::set_thread_count(3);
  const Image three = relighter().relight(room_map(), ErrorGoal{0.001}).image;
  core::set_thread_count(0);
  CHECK(largest_difference(one, three) <= 1e-6 * largest(one));
}

TEST_CASE("goals that cannot be are refused", "[planner]") {
  const Environment map = constant_map(1);
  CHECK_THROWS_AS(relighter().relight(map, ErrorGoal{0}), core::UsageError);
  CHECK_THROWS_AS(relighter().relight(map, ErrorGoal{-1}), core::UsageError);
  CHECK_THROWS_AS(relighter().relight(map, relight::TimeGoal{0}), core::UsageError);
  CHECK_THROWS_AS(relighter().plan(map, ErrorGoal{NAN}), core::UsageError);
}

}  // namespace lightstage
