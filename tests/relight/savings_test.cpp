// Each thing that relighting by plan leaves out, put back: what it saves, and what it costs.
#include <algorithm>
#include <catch2/catch.hpp>
#include <chrono>
#include <cmath>

#include "model/classical.h"
#include "model/picture_sum.h"
#include "relight/environment_relighter.h"
#include "relight/known_subject.h"
#include "relight/magnitude.h"
#include "relight/plan_execution.h"
#include "relight/relight.h"
#include "relight/sky.h"
#include "relight/smooth_light.h"

namespace lightstage {

namespace {

using core::Image;
using core::Vec3;
using relight::CapturedKnowledge;
using relight::Cut;
using relight::DoubtfulLight;
using relight::Environment;
using relight::EnvironmentPlanner;
using relight::ErrorGoal;
using relight::ErrorMeasure;
using relight::LightClusters;
using relight::Patch;
using relight::Plan;
using relight::PlanExecution;
using test::KnownSubject;

constexpr core::ImageSize kSize{40, 41, 3};

const KnownSubject& subject() {
  static const KnownSubject known(200, kSize, test::shiny_ball(kSize));
  return known;
}

const CapturedKnowledge& captured() {
  static const CapturedKnowledge known(subject().scan());
  return known;
}

const Environment& sky() {
  static const Environment map = relight::clear_sky({.height = 32});
  return map;
}

double relative_rms(const Image& picture, const Image& truth) {
  Image difference = picture;
  for (std::size_t i = 0; i < difference.values().size(); ++i) difference.values()[i] -= truth.values()[i];
  return relight::masked_rms(difference, {}) / relight::masked_rms(truth, {});
}

// As the planner looks at a map, with the smooth part taken off or left in.
std::vector<DoubtfulLight> doubtful_light(const Environment& map, bool without_smooth) {
  const std::vector<Patch> patches = map.patches(captured().differences.spacing() / 8);
  std::vector<relight::LightDifferences::NearestLight> nearest;
  for (const Patch& patch : patches) nearest.push_back(captured().differences.nearest(patch.light.direction));
  const std::vector<Vec3> smooth =
      relight::smooth_light(patches, nearest, captured().differences, *captured().barycentric);
  std::vector<DoubtfulLight> lights;
  for (std::size_t p = 0; p < patches.size(); ++p)
    lights.push_back({patches[p].light.direction,
                      without_smooth ? patches[p].light.irradiance - smooth[p] : patches[p].light.irradiance,
                      captured().differences.expected(nearest[p]), captured().differences.between_lights(nearest[p])});
  return lights;
}

}  // namespace

TEST_CASE("captured lights carry the map: without them as many pictures come nowhere near", "[savings]") {
  const Image truth = relight::relight_lights(subject(), sky().lights(0)).image;
  const EnvironmentPlanner planner(captured(), subject().scan(), sky());
  Plan plan = planner.within(ErrorGoal{0.001});
  REQUIRE(plan.pictures() > 0);
  PlanExecution execution(captured(), subject(), planner.captured_colours());
  const double with = relative_rms(execution.carry_out(plan), truth);
  // The same number of pictures, each for the light nearest to it.
  const auto alone = sky().gather(core::fibonacci_directions(std::max<std::size_t>(plan.pictures(), 8)));
  const double without = relative_rms(relight::relight_lights(subject(), alone).image, truth);
  INFO(plan.pictures() << " pictures: " << with << " with, " << without << " without");
  CHECK(with < 0.1 * without);
}

TEST_CASE("the smooth part need not be represented: with it left in, the same error takes more pictures", "[savings]") {
  Image bright(32, 64, 3);
  for (int y = 0; y < 32; ++y)
    for (int x = 0; x < 64; ++x)
      for (int c = 0; c < 3; ++c) bright(y, x, c) = float(1 + 0.6 * std::sin(0.1 * x) * std::cos(0.1 * y));
  bright(9, 20, 0) = 300;
  const Environment map(bright);
  const LightClusters without(doubtful_light(map, true), captured().differences.spacing());
  const LightClusters with(doubtful_light(map, false), captured().differences.spacing());
  const double allowed = 1e-3 * with.at_most(0).variance.total();
  const std::size_t few = without.within(allowed).representatives.size(),
                    many = with.within(allowed).representatives.size();
  INFO(few << " pictures without it, " << many << " with it");
  CHECK(few < many / 2);
}

TEST_CASE("one picture stands for lights near to each other: patch by patch many more are needed", "[savings]") {
  Image map(64, 128, 3);
  for (int y = 18; y < 22; ++y)
    for (int x = 30; x < 35; ++x) map(y, x, 1) = 40;
  const std::vector<DoubtfulLight> lights = doubtful_light(Environment(map), true);
  const LightClusters clusters(lights, captured().differences.spacing());
  const double allowed = 5e-2 * clusters.at_most(0).variance.total();
  const std::size_t by_cluster = clusters.within(allowed).representatives.size();
  // Patches, the worst first, until the others together are wrong by no more.
  std::vector<double> sizes;
  double left = 0;
  for (const DoubtfulLight& light : lights)
    left += sizes.emplace_back(relight::magnitude(light.irradiance) * light.error);
  std::sort(sizes.rbegin(), sizes.rend());
  std::size_t by_patch = 0;
  while (left * left > allowed) left -= sizes[by_patch++];
  INFO(by_cluster << " by cluster, " << by_patch << " by patch");
  CHECK(by_cluster * 3 <= by_patch * 2);
}

TEST_CASE("samples of the remainder take off what is wrong everywhere a little", "[savings]") {
  // Sums of display-encoded values are darker than linear ones under light from all around.
  const auto darker = model::make_rbf(subject().scan(), model::Domain::kDisplay);
  Image even(16, 32, 3);
  std::fill(even.values().begin(), even.values().end(), 1.0F);
  const Environment map(even);
  const Image truth = relight::relight_lights(*darker, map.lights(0)).image;
  const EnvironmentPlanner planner(captured(), subject().scan(), map);
  Plan plan = planner.within(ErrorGoal{0.004, ErrorMeasure::kRelativeRms});
  REQUIRE_FALSE(plan.remainder.empty());
  Plan without = plan;
  without.remainder.clear();
  PlanExecution execution(captured(), *darker, planner.captured_colours());
  const double wrong = relative_rms(execution.carry_out(without), truth);
  const double sampled = relative_rms(execution.carry_out(plan), truth);
  INFO(plan.remainder.size() << " samples: " << sampled << " with, " << wrong << " without");
  CHECK(sampled < 0.7 * wrong);
  CHECK(sampled <= 0.004);
}

TEST_CASE("samples that there was no time for are not counted as taken", "[savings]") {
  Image even(16, 32, 3);
  std::fill(even.values().begin(), even.values().end(), 1.0F);
  const EnvironmentPlanner planner(captured(), subject().scan(), Environment(even));
  const double without = planner.at_most(0).expected_error(ErrorMeasure::kRelativeRms);
  Plan plan = planner.within(ErrorGoal{0.004, ErrorMeasure::kRelativeRms});
  REQUIRE_FALSE(plan.remainder.empty());
  plan.smooth_variance = plan.unsampled_smooth_variance / 4;  // what the samples promise
  REQUIRE(plan.expected_error(ErrorMeasure::kRelativeRms) < 0.9 * without);
  PlanExecution execution(captured(), subject(), planner.captured_colours());
  execution.carry_out(plan, std::chrono::steady_clock::now());
  CHECK(execution.directions_synthesised() == 0);
  CHECK(plan.pictures() == 0);
  CHECK(plan.expected_error(ErrorMeasure::kRelativeRms) == Approx(without));
}

TEST_CASE("samples are an unbiased estimate: weighted by the light that they stand for, they have all of it",
          "[savings]") {
  Image even(16, 32, 3);
  std::fill(even.values().begin(), even.values().end(), 1.0F);
  const Environment map(even);
  const EnvironmentPlanner planner(captured(), subject().scan(), map);
  const Plan plan = planner.within(ErrorGoal{0.002, ErrorMeasure::kRelativeRms});
  REQUIRE(plan.remainder.size() > 100);
  double sum = 0;
  Vec3 moment;
  for (const relight::DistantLight& light : plan.remainder) {
    sum += light.irradiance.x;
    moment = moment + light.irradiance.x * light.direction.vec();
  }
  CHECK(sum == Approx(4).epsilon(0.1));  // 4 pi steradians in units of pi
  CHECK(core::norm(moment) < 0.2);       // of 4: from all around alike
}

TEST_CASE("light from where a light stands is taken from the capture", "[savings]") {
  Image map(16, 32, 3);
  const Environment places(map);
  const core::Direction at = places.direction(5, 11);
  std::vector<core::Direction> lights = core::fibonacci_directions(80);
  lights.push_back(at);
  const core::OlatScan scan = test::scan_of(lights, kSize, test::shiny_ball(kSize));
  const auto method = model::make_rbf(scan, model::Domain::kDisplay);
  map(5, 11, 0) = 100;
  const auto report = relight::EnvironmentRelighter(*method).relight(Environment(map), ErrorGoal{1e-4});
  CHECK(report.directions_synthesised == 0);
  const Image truth = relight::relight_lights(*method, Environment(map).lights(0)).image;
  CHECK(relative_rms(report.image, truth) < 1e-3);
}

TEST_CASE("pictures of one round serve the next", "[savings]") {
  const KnownSubject counted(200, kSize, test::shiny_ball(kSize));
  const EnvironmentPlanner planner(captured(), counted.scan(), sky());
  PlanExecution execution(captured(), counted, planner.captured_colours());
  Plan plan = planner.at_most(12);
  const Image first = execution.carry_out(plan);
  const int rendered = counted.rendered;
  CHECK(execution.carry_out(plan) == first);
  CHECK(counted.rendered == rendered);
  CHECK(execution.directions_synthesised() == std::size_t(rendered));
}

}  // namespace lightstage
