#include <catch2/catch.hpp>

#include "core/error.h"
#include "sim/scene/true_lights.h"
#include "world_scene.h"

using namespace lightstage;

namespace {

capture::Stage stage_of(std::size_t lights) {
  return test::still_simulation(sim::SubjectKind::kGreyBall, lights, 8).stage;
}

double standard_deviation(const std::vector<double>& values) {
  double sum = 0, squares = 0;
  for (const double v : values) sum += v;
  const double mean = sum / double(values.size());
  for (const double v : values) squares += (v - mean) * (v - mean);
  return std::sqrt(squares / double(values.size() - 1));
}

}  // namespace

TEST_CASE("without errors the true lights are the drawn ones") {
  const capture::Stage stage = stage_of(50);
  const std::vector<core::Light> lights = sim::true_lights(stage);
  REQUIRE(lights.size() == 50);
  for (std::size_t i = 0; i < lights.size(); ++i) {
    CHECK(*lights[i].position == stage.light_positions[i]);
    CHECK(lights[i].gain == std::array<double, 3>{1, 1, 1});
  }
}

TEST_CASE("lights are displaced along both tangents by the stated deviation, at their distance") {
  capture::Stage stage = stage_of(4000);
  stage.simulation.mount_error_degrees = 0.5;
  const std::vector<core::Light> lights = sim::true_lights(stage);
  double squares = 0;
  for (std::size_t i = 0; i < lights.size(); ++i) {
    CHECK(core::norm(*lights[i].position) == Approx(stage.radius_m).epsilon(1e-12));
    const core::Direction drawn = core::Direction::from_vector(stage.light_positions[i]);
    const double angle = core::degrees_from_radians(core::angle_radians(drawn, lights[i].direction));
    squares += angle * angle;
  }
  // Two components of variance 0.25 each; the mean of 4000 has a relative deviation of 1/sqrt(4000).
  CHECK(squares / 4000 == Approx(0.5).epsilon(0.06));
}

TEST_CASE("gains are log-normal with the stated deviation, mostly common to the channels") {
  capture::Stage stage = stage_of(4000);
  stage.simulation.gain_spread = 0.2;
  std::vector<double> red, difference;
  for (const core::Light& light : sim::true_lights(stage)) {
    red.push_back(std::log(light.gain[0]));
    difference.push_back(std::log(light.gain[0]) - std::log(light.gain[1]));
  }
  CHECK(standard_deviation(red) == Approx(0.2).epsilon(0.05));
  CHECK(standard_deviation(difference) == Approx(0.2 * std::sqrt(0.5)).epsilon(0.05));
}

TEST_CASE("adding lights leaves the others as they are, another seed moves them") {
  capture::Stage stage = stage_of(30);
  stage.simulation.mount_error_degrees = 1;
  stage.simulation.gain_spread = 0.1;
  const std::vector<core::Light> before = sim::true_lights(stage);
  stage.light_positions.push_back({0, 1.5, 0});
  const std::vector<core::Light> more = sim::true_lights(stage);
  stage.simulation.seed = 2;
  const std::vector<core::Light> other = sim::true_lights(stage);
  for (std::size_t i = 0; i < before.size(); ++i) {
    CHECK(*more[i].position == *before[i].position);
    CHECK(more[i].gain == before[i].gain);
    CHECK_FALSE(*other[i].position == *before[i].position);
  }
}

TEST_CASE("dead lights give nothing, and those that do not exist are refused") {
  capture::Stage stage = stage_of(5);
  stage.simulation.dead_lights = {3};
  CHECK(sim::true_lights(stage)[3].gain == std::array<double, 3>{0, 0, 0});
  stage.simulation.dead_lights = {5};
  CHECK_THROWS_AS(sim::true_lights(stage), core::BadInput);
  stage.simulation.dead_lights = {};
  stage.light_positions[2] = {0, 0, 0};
  CHECK_THROWS_AS(sim::true_lights(stage), core::BadInput);
}
