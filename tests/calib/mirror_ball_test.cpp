#include "calib/mirror_ball.h"

#include <catch2/catch.hpp>

#include "calib/ball_pictures.h"
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
  const core::Image full_on = test::sum(test::lambertian_ball(pass.camera, pass.true_ball, pass.lamps, 0.01, blur_px),
                                        test::mirror_reflections(pass.camera, pass.true_ball, pass.lamps, blur_px));
  pass.ball = locate_sphere(test::through_sensor(full_on, 0.045, 1), pass.camera, pass.true_ball.radius_m);
  for (std::size_t i = 0; i < lights; ++i) {
    const core::Image radiance = test::mirror_reflections(pass.camera, pass.true_ball, {pass.lamps[i]}, blur_px);
    pass.estimates.push_back(estimate_light({int(i), test::through_sensor(radiance, exposure, i + 2), 1 / exposure},
                                            pass.camera, pass.ball, kStageRadius));
  }
  return pass;
}

}  // namespace

TEST_CASE("one pass over a mirror ball places the lights of a stage") {
  // The exposure of the single lights, at which highlights are 14000 times too bright, and one that does not
  // clip.
  const double exposure = GENERATE(0.9, 6e-5);
  const Pass pass = run_pass(512, 0.5, exposure, 60);
  CHECK(norm(pass.ball.centre - pass.true_ball.centre) < 6e-4);
  std::vector<double> errors, ratios;
  for (const LightEstimate& e : pass.estimates) {
    const Vec3 truth = pass.lamps[std::size_t(e.light_index)].position;
    INFO("light " << e.light_index << ", " << test::degrees_between(truth, {0, 0, 1})
                  << " degrees from the camera: " << e.reason);
    if (test::degrees_between(truth, {0, 0, 1}) < 150) CHECK(e.placed);
    if (!e.placed) continue;
    errors.push_back(test::degrees_between(e.position, truth));
    ratios.push_back(errors.back() / e.sigma_degrees);
    CHECK(ratios.back() < 4);
    CHECK(norm(e.position) == Approx(kStageRadius));
  }
  INFO("median " << test::median(errors) << ", 90 % " << test::percentile(errors, 0.9) << ", largest "
                 << test::percentile(errors, 1) << " degrees; over sigma: median " << test::median(ratios));
  CHECK(errors.size() >= 57);
  CHECK(test::median(errors) < 0.08);
  CHECK(test::percentile(errors, 0.9) < 0.25);
  // The stated error is neither a fraction nor a multiple of the true one.
  CHECK(test::median(ratios) > 0.15);
  CHECK(test::median(ratios) < 1.2);
}

TEST_CASE("the light that falls back from the highlight is the light there was") {
  const core::CameraModel camera = test::stage_camera(256);
  const Sphere ball{{0.01, -0.02, 0.03}, 0.06, 0, 0};
  for (const core::Direction& d : core::fibonacci_directions(60)) {
    const test::Lamp lamp{d.vec() * kStageRadius, 0.001};
    const core::Image image = test::mirror_reflections(camera, ball, {lamp}, 0.6);
    double flux = 0, x = 0, y = 0;
    for (int row = 0; row < 256; ++row) {
      for (int column = 0; column < 256; ++column) {
        flux += double(image(row, column));
        x += double(image(row, column)) * column;
        y += double(image(row, column)) * row;
      }
    }
    if (flux == 0 || d.z() < -0.9) continue;
    const auto ray = reflect_at(camera, ball, {x / flux, y / flux});
    REQUIRE(ray);
    CHECK(norm(ray->direction) == Approx(1));
    CHECK(norm(ray->origin - ball.centre) == Approx(ball.radius_m));
    CHECK(test::degrees_between(ray->direction, lamp.position - ray->origin) < 0.02);
  }
}

TEST_CASE("a ray that misses the ball is not reflected, one through its middle comes straight back") {
  const core::CameraModel camera = test::stage_camera(256);
  const Sphere ball{{0, 0, 0}, 0.06, 0, 0};
  CHECK_FALSE(reflect_at(camera, ball, {0, 0}));
  const auto back = reflect_at(camera, ball, {camera.cx, camera.cy});
  REQUIRE(back);
  CHECK(back->direction.z == Approx(1));
  CHECK(back->origin.z == Approx(0.06));
  Sphere behind = ball;
  behind.centre = {0, 0, 5};
  CHECK_FALSE(reflect_at(camera, behind, {camera.cx, camera.cy}));
}

TEST_CASE("estimates from several balls are joined by their certainty") {
  const auto estimate = [](int light, double longitude, double sigma, bool placed = true) {
    LightEstimate e;
    e.light_index = light;
    e.placed = placed;
    e.direction = core::Direction::from_longitude_latitude_degrees(longitude, 0);
    e.position = e.direction.vec() * kStageRadius;
    e.sigma_degrees = sigma;
    if (!placed) e.reason = "dead";
    return e;
  };
  const std::vector<std::vector<LightEstimate>> balls{
      {estimate(0, 10, 0.1), estimate(1, 20, 0.2), estimate(2, 0, 0, false), estimate(3, 50, 0.3),
       estimate(5, 1, 0, false)},
      {estimate(3, 58, 0.1), estimate(0, 10.3, 0.2), estimate(1, 0, 0, false), estimate(2, 0, 0, false)}};
  const std::vector<LightEstimate> joined = combine_estimates(balls);
  REQUIRE(joined.size() == 5);
  // Weights 1 / 0.01 and 1 / 0.04: four to one.
  CHECK(joined[0].direction.longitude_degrees() == Approx(10.06).margin(1e-3));
  CHECK(joined[0].sigma_degrees == Approx(0.1 / std::sqrt(1.25)));
  CHECK(norm(joined[0].position) == Approx(kStageRadius));
  CHECK(joined[1].direction.longitude_degrees() == Approx(20));
  CHECK_FALSE(joined[2].placed);
  CHECK(joined[2].reason == "dead");
  // 8 degrees apart: the more certain one stands.
  CHECK(joined[3].direction.longitude_degrees() == Approx(58));
  CHECK(joined[4].light_index == 5);
  CHECK(combine_estimates({}).empty());
}

}  // namespace lightstage::calib
