// Calibration of a simulated stage, as an operator would do it: one pass over the mirror ball, one over the grey ball.
#include <catch2/catch.hpp>

#include "calib/ball_pictures.h"
#include "calib/light_gain.h"
#include "calib/mirror_ball.h"
#include "capture/stage.h"
#include "sim/sensor.h"
#include "sim/world.h"

namespace lightstage::calib {

namespace {

constexpr core::Nanoseconds kExposure = 20 * core::kMillisecond;
constexpr core::Nanoseconds kFullOnExposure = core::kMillisecond;
constexpr std::size_t kDeadLight = 3;

sim::Simulation simulation_of(sim::SubjectKind subject, std::size_t lights) {
  sim::Simulation simulation;
  capture::LayoutOptions layout;
  layout.lights = lights;
  simulation.stage = capture::make_stage("test", layout);
  simulation.stage.simulation.seed = 5;
  simulation.stage.simulation.mount_error_degrees = 1;
  simulation.stage.simulation.gain_spread = 0.15;
  simulation.stage.simulation.dead_lights = {int(kDeadLight)};
  simulation.subject.kind = subject;
  simulation.motion = {0, 0};
  return simulation;
}

// What the first camera reports with these lights on.
core::Image shoot(const sim::World& world, const std::vector<capture::LightLevel>& levels, core::Nanoseconds exposure,
                  std::uint64_t seed) {
  const capture::StageCamera& camera = world.simulation().stage.cameras.front();
  return sim::sense(world.render(camera.model, levels, 0), world.simulation().sensor, camera.responsivity, exposure,
                    seed);
}

std::vector<capture::LightLevel> all_on(std::size_t lights) {
  std::vector<capture::LightLevel> levels;
  for (std::size_t i = 0; i < lights; ++i) levels.push_back({int(i)});
  return levels;
}

}  // namespace

TEST_CASE("a simulated stage is calibrated from one mirror ball and one grey ball") {
  constexpr std::size_t kLights = 40;
  const sim::World mirror(simulation_of(sim::SubjectKind::kMirrorBall, kLights));
  const sim::World grey(simulation_of(sim::SubjectKind::kGreyBall, kLights));
  const capture::StageCamera& camera = mirror.simulation().stage.cameras.front();
  const double stage_radius = mirror.simulation().stage.radius_m;
  const double ball_radius = sim::subject_size_m(mirror.simulation().subject);
  const double saturation = sim::saturation_radiance(camera.responsivity, kExposure);

  const Sphere ball = locate_sphere(shoot(mirror, all_on(kLights), kFullOnExposure, 1000), camera.model, ball_radius);
  const Sphere grey_ball =
      locate_sphere(shoot(grey, all_on(kLights), kFullOnExposure, 1001), camera.model, ball_radius);
  // The balls are at the stage centre; a millimetre in depth is 0.05 px of the outline.
  CHECK(norm(ball.centre) < 1e-3);
  CHECK(norm(grey_ball.centre) < 1e-3);

  std::vector<double> direction_errors, gain_errors, ratios;
  for (std::size_t i = 0; i < kLights; ++i) {
    const core::Light& truth = mirror.true_lights()[i];
    const LightEstimate light =
        estimate_light({int(i), shoot(mirror, {{int(i)}}, kExposure, i), saturation}, camera.model, ball, stage_radius);
    if (i == kDeadLight) {
      CHECK_FALSE(light.placed);
      continue;
    }
    const double from_camera = test::degrees_between(truth.direction.vec(), {0, 0, 1});
    INFO("light " << i << ", " << from_camera << " degrees from the camera: " << light.reason);
    if (from_camera < 155) CHECK(light.placed);
    if (!light.placed) continue;
    direction_errors.push_back(test::degrees_between(light.direction.vec(), truth.direction.vec()));
    ratios.push_back(direction_errors.back() / light.sigma_degrees);
    CHECK(ratios.back() < 4);
    const GainEstimate gain = estimate_gain(shoot(grey, {{int(i)}}, kExposure, 500 + i), camera.model, grey_ball,
                                            grey.simulation().subject.albedo, light.position, saturation);
    if (from_camera < 140) CHECK(gain.measured);
    if (!gain.measured) continue;
    for (std::size_t c = 0; c < 3; ++c) gain_errors.push_back(std::abs(gain.gain[c] / truth.gain[c] - 1));
  }
  INFO("directions: median " << test::median(direction_errors) << ", 90 % " << test::percentile(direction_errors, 0.9)
                             << ", largest " << test::percentile(direction_errors, 1) << " degrees; gains: median "
                             << test::median(gain_errors) << ", largest " << test::percentile(gain_errors, 1));
  CHECK(direction_errors.size() >= kLights - 3);
  CHECK(test::median(direction_errors) < 0.12);
  CHECK(test::percentile(direction_errors, 0.9) < 0.3);
  CHECK(test::median(ratios) > 0.3);
  CHECK(test::median(ratios) < 1.3);
  CHECK(test::median(gain_errors) < 0.01);
  CHECK(test::percentile(gain_errors, 1) < 0.04);
}

}  // namespace lightstage::calib
