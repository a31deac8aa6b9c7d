#include "calib/mirror_ball.h"

#include <catch2/catch.hpp>

#include "calib/ball_pictures.h"
#include <iostream>
#include "core/sphere.h"

namespace lightstage::calib {

using core::Vec3;

namespace {

constexpr double kStageRadius = 1.5;

struct Pass {
  core::CameraModel camera;
  Sphere true_ball;
  Sphere ball;
  std::vector<test::Lamp> lamps;
  std::vector<LightEstimate> estimates;
};

// A whole mirror-ball pass as the stage would take it.
Pass run_pass(int pixels, double blur_px, double exposure, std::size_t lights) {
  Pass pass;
  pass.camera = test::stage_camera(pixels);
  pass.true_ball = Sphere{{0.004, -0.003, 0.005}, 0.06, 0, 0};
  pass.lamps = test::stage_lamps(lights, kStageRadius, 1.0, 11);
  const core::Image full_on =
      test::sum(test::lambertian_ball(pass.camera, pass.true_ball, pass.lamps, 0.01, blur_px),
                test::mirror_reflections(pass.camera, pass.true_ball, pass.lamps, blur_px));
  pass.ball = locate_sphere(test::through_sensor(full_on, 0.045, 1), pass.camera, pass.true_ball.radius_m);
  for (std::size_t i = 0; i < lights; ++i) {
    const core::Image radiance = test::mirror_reflections(pass.camera, pass.true_ball, {pass.lamps[i]}, blur_px);
    pass.estimates.push_back(
        estimate_light({int(i), test::through_sensor(radiance, exposure, i + 2), 1 / exposure}, pass.camera, pass.ball,
                       kStageRadius));
  }
  return pass;
}

}  // namespace

TEST_CASE("one pass over a mirror ball places the lights of a stage") {
  const double exposure = GENERATE(0.9, 6e-5);
  const Pass pass = run_pass(512, 0.5, exposure, 160);
  const Vec3 off = pass.ball.centre - pass.true_ball.centre;
  std::cout << "ball off by mm " << off.x * 1e3 << " " << off.y * 1e3 << " " << off.z * 1e3 << " rms "
            << pass.ball.outline_rms_px << " points " << pass.ball.outline_points << "\n";
  std::vector<double> errors, ratios, predicted;
  int unplaced = 0;
  for (const LightEstimate& e : pass.estimates) {
    if (!e.placed) {
      ++unplaced;
      std::cout << "  unplaced " << e.light_index << " " << e.reason << " sigma " << e.sigma_degrees << " at "
                << test::degrees_between(pass.lamps[std::size_t(e.light_index)].position, {0, 0, 1}) << "\n";
      continue;
    }
    const double error = test::degrees_between(e.position, pass.lamps[std::size_t(e.light_index)].position);
    errors.push_back(error);
    predicted.push_back(e.sigma_degrees);
    ratios.push_back(error / e.sigma_degrees);
    if (error > 0.3) {
      std::cout << "  light " << e.light_index << " error " << error << " sigma " << e.sigma_degrees << " at "
                << test::degrees_between(pass.lamps[std::size_t(e.light_index)].position, {0, 0, 1}) << "\n";
    }
  }
  std::cout << "exposure " << exposure << " median " << test::median(errors) << " p90 " << test::percentile(errors, 0.9)
            << " max " << test::percentile(errors, 1) << " unplaced " << unplaced << " median sigma "
            << test::median(predicted) << " median ratio " << test::median(ratios) << " p95 ratio "
            << test::percentile(ratios, 0.95) << "\n";
  CHECK(test::median(errors) < 0.1);
}

}  // namespace lightstage::calib
