// Near lights from two balls: bundle adjustment against rendered and computed truth.
#include "calib/light_bundle.h"

#include <catch2/catch.hpp>
#include <random>

#include "calib/ball/cone.h"
#include "calib/ball_pictures.h"
#include "calib/mirror_ball.h"
#include "core/error.h"
#include "core/sphere.h"

namespace lightstage::calib {

using core::Vec3;

namespace {

// A camera 1.9 m from stage centre that sees about 0.6 m, with barrel distortion.
core::CameraModel camera_at(Vec3 position, int pixels) {
  core::CameraModel camera = core::look_at(position, {0, 0, 0}, pixels, pixels, 18);
  camera.k1 = -0.08;
  return camera;
}

// Lights from 1.2 to 2.5 m all around but behind the balls, as the cameras see them.
std::vector<test::Lamp> lamps(std::size_t n) {
  std::vector<test::Lamp> result;
  const std::vector<core::Direction> directions = core::fibonacci_directions(n);
  for (std::size_t i = 0; i < n; ++i) {
    if (directions[i].z() > -0.7) result.push_back({directions[i].vec() * (1.2 + 1.3 * double(i * 7 % n) / double(n))});
  }
  return result;
}

// Errors over what the bundle says of them, along the three axes of each light.
std::vector<double> normalised(const BundledLight& light, Vec3 truth) {
  const Vec3 off = light.position - truth;
  return {off.x / std::sqrt(light.covariance.rows[0].x), off.y / std::sqrt(light.covariance.rows[1].y),
          off.z / std::sqrt(light.covariance.rows[2].z)};
}

double root_mean_square(const std::vector<double>& values) {
  double sum = 0;
  for (const double v : values) sum += v * v;
  return std::sqrt(sum / double(values.size()));
}

// Highlights as the formula predicts them, with normal errors of `sigma_px`; balls as their outlines would show them.
BundleInput computed(const std::vector<core::CameraModel>& cameras, const std::vector<Sphere>& balls,
                     const std::vector<test::Lamp>& lights, double sigma_px, std::uint64_t seed) {
  std::mt19937_64 random(seed);
  std::normal_distribution<double> normal(0, 1);
  BundleInput input;
  input.cameras = cameras;
  for (std::size_t c = 0; c < cameras.size(); ++c) {
    for (std::size_t b = 0; b < balls.size(); ++b) {
      Sphere seen = balls[b];
      seen.outline_points = 300;
      seen.outline_rms_px = 0.3;
      const double distance = norm(seen.centre - cameras[c].centre());
      const double metres_per_px = distance / cameras[c].fx;
      const OutlineSigma sigma = outline_sigma(seen);
      const core::Mat3& axes = cameras[c].stage_from_camera.rotation;
      const double across = sigma.centre_px * metres_per_px;
      const double along = sigma.radius_px * metres_per_px * distance / seen.radius_m;
      seen.centre = seen.centre + axes * Vec3{across * normal(random), across * normal(random), along * normal(random)};
      input.outlines.push_back({c, b, seen});
      for (std::size_t i = 0; i < lights.size(); ++i) {
        const auto p = predict_highlight(cameras[c], balls[b], lights[i].position);
        if (!p) continue;
        input.highlights.push_back(
            {int(i), c, b, {p->x + sigma_px * normal(random), p->y + sigma_px * normal(random)}, sigma_px});
      }
    }
  }
  return input;
}

const std::vector<Sphere> kTwoBalls{{{-0.2, -0.02, 0.01}, 0.06, 0, 0}, {{0.19, 0.03, -0.02}, 0.06, 0, 0}};

}  // namespace

TEST_CASE("a predicted highlight lies where its reflection falls back on the light") {
  const core::CameraModel camera = camera_at({0.3, 0.1, 1.8}, 800);
  for (const test::Lamp& lamp : lamps(60)) {
    for (const Sphere& ball : kTwoBalls) {
      const auto pixel = predict_highlight(camera, ball, lamp.position);
      REQUIRE(pixel);
      const auto ray = reflect_at(camera, ball, *pixel);
      REQUIRE(ray);
      CHECK(test::degrees_between(ray->direction, lamp.position - ray->origin) < 1e-4);
    }
  }
  // Behind the ball, in line with the camera, and inside it.
  const Sphere ball{{0, 0, 0}, 0.06, 0, 0};
  CHECK_FALSE(predict_highlight(camera, ball, camera.centre() * -1.0));
  CHECK_FALSE(predict_highlight(camera, ball, {0.01, 0, 0}));
  CHECK(predict_highlight(camera, ball, camera.centre() * 0.5));
}

TEST_CASE("bundle adjustment finds near lights, and its standard errors are the true ones") {
  const std::vector<core::CameraModel> cameras{camera_at({0, 0, 1.9}, 1024)};
  const std::vector<test::Lamp> lights = lamps(40);
  std::vector<double> ratios;
  for (std::uint64_t seed = 1; seed <= 12; ++seed) {
    const BundleResult result = bundle_lights(computed(cameras, kTwoBalls, lights, 0.05, seed));
    REQUIRE(result.lights.size() == lights.size());
    for (const BundledLight& light : result.lights) {
      REQUIRE(light.placed);
      for (const double r : normalised(light, lights[std::size_t(light.light_index)].position)) ratios.push_back(r);
    }
    CHECK(result.rms_px < 0.05);
  }
  const double spread = root_mean_square(ratios);
  INFO("normalised errors: " << spread);
  CHECK(spread > 0.8);
  CHECK(spread < 1.25);
}

TEST_CASE("a wrong highlight is left out or its light is not placed, and the others stay as they were") {
  const std::vector<core::CameraModel> cameras{camera_at({0, 0, 1.9}, 1024), camera_at({0.9, 0, 1.6}, 1024)};
  const std::vector<test::Lamp> lights = lamps(20);
  BundleInput input = computed(cameras, kTwoBalls, lights, 0.03, 5);
  const BundleResult before = bundle_lights(input);
  for (HighlightSeen& seen : input.highlights) {
    if (seen.light_index == 3 && seen.camera == 1 && seen.ball == 0) seen.position.x += 9;
  }
  const BundleResult after = bundle_lights(input);
  REQUIRE(after.lights.size() == before.lights.size());
  for (std::size_t i = 0; i < after.lights.size(); ++i) {
    CHECK(after.lights[i].placed);
    const double moved = norm(after.lights[i].position - before.lights[i].position);
    CHECK(moved < (i == 3 ? 3 : 0.5) * after.lights[i].sigma_m);
  }
  CHECK(after.lights[3].reason.find("camera 1, ball 0") != std::string::npos);

  BundleInput one_camera = computed({cameras[0]}, kTwoBalls, lights, 0.03, 5);
  for (HighlightSeen& seen : one_camera.highlights) {
    if (seen.light_index == 3 && seen.ball == 0) seen.position.y += 9;
  }
  const BundleResult contradicted = bundle_lights(one_camera);
  CHECK_FALSE(contradicted.lights[3].placed);
  CHECK(contradicted.lights[3].reason.find("contradict") != std::string::npos);
  CHECK(contradicted.lights[4].placed);
}

TEST_CASE("one ball gives directions only with the stage's radius") {
  const std::vector<core::CameraModel> cameras{camera_at({0, 0, 1.9}, 1024)};
  std::vector<test::Lamp> lights = lamps(30);
  for (test::Lamp& lamp : lights) lamp.position = lamp.position * (1.5 / norm(lamp.position));
  BundleInput input = computed(cameras, {kTwoBalls[0]}, lights, 0.03, 2);
  for (const BundledLight& light : bundle_lights(input).lights) {
    CHECK_FALSE(light.placed);
    CHECK(light.reason.find("seen only once") != std::string::npos);
  }
  for (std::size_t i = 0; i < lights.size(); ++i) input.distances[int(i)] = {1.5, 0.01};
  for (const BundledLight& light : bundle_lights(input).lights) {
    REQUIRE(light.placed);
    CHECK(test::degrees_between(light.position, lights[std::size_t(light.light_index)].position) <
          4 * light.sigma_degrees);
    CHECK(light.sigma_degrees < 0.3);
  }
}

TEST_CASE("what makes no bundle is refused") {
  const std::vector<core::CameraModel> cameras{camera_at({0, 0, 1.9}, 1024)};
  const BundleInput good = computed(cameras, kTwoBalls, lamps(5), 0.03, 2);
  BundleInput bad = good;
  bad.highlights[0].ball = 7;
  CHECK_THROWS_AS(bundle_lights(bad), core::BadInput);
  bad = good;
  bad.highlights[0].sigma_px = 0;
  CHECK_THROWS_AS(bundle_lights(bad), core::BadInput);
  bad = good;
  bad.outlines[0].camera = 3;
  CHECK_THROWS_AS(bundle_lights(bad), core::BadInput);
  bad = good;
  bad.distances[0] = {0, 1};
  CHECK_THROWS_AS(bundle_lights(bad), core::BadInput);
  CHECK(bundle_lights({}).lights.empty());
}

TEST_CASE("positions of lights from pictures of two balls with noise, distortion and clipped highlights") {
  const core::CameraModel camera = camera_at({0, 0, 1.9}, 1400);
  const std::vector<test::Lamp> lights = lamps(40);
  BundleInput input;
  for (std::size_t b = 0; b < kTwoBalls.size(); ++b) {
    // The part of the camera's picture that shows the ball, which is all that counts.
    constexpr int kCrop = 380;
    const auto middle = camera.project(kTwoBalls[b].centre);
    core::CameraModel crop = camera;
    crop.width = crop.height = kCrop;
    crop.cx -= std::round(middle->x) - kCrop / 2;
    crop.cy -= std::round(middle->y) - kCrop / 2;
    const core::Image full_on = test::sum(test::lambertian_ball(crop, kTwoBalls[b], lights, 0.01, 0.5),
                                          test::mirror_reflections(crop, kTwoBalls[b], lights, 0.5));
    const Sphere ball = locate_sphere(test::through_sensor(full_on, 0.12, b), crop, kTwoBalls[b].radius_m);
    input.cameras.push_back(crop);
    input.outlines.push_back({b, b, ball});
    for (std::size_t i = 0; i < lights.size(); ++i) {
      const core::Image radiance = test::mirror_reflections(crop, kTwoBalls[b], {lights[i]}, 0.5);
      const auto highlight = find_highlight(test::through_sensor(radiance, 0.9, 100 + 2 * i + b), crop, ball, 1 / 0.9);
      REQUIRE(highlight);
      input.highlights.push_back({int(i), b, b, highlight->position, highlight->sigma_px});
    }
  }
  const BundleResult result = bundle_lights(input);
  std::vector<double> degrees, metres, ratios;
  for (const BundledLight& light : result.lights) {
    INFO(light.light_index << ": " << light.reason);
    CHECK(light.placed);
    if (!light.placed) continue;
    const Vec3 truth = lights[std::size_t(light.light_index)].position;
    degrees.push_back(test::degrees_between(light.position, truth));
    metres.push_back(norm(light.position - truth));
    for (const double r : normalised(light, truth)) ratios.push_back(r);
  }
  INFO("directions: median " << test::median(degrees) << ", 95 % " << test::percentile(degrees, 0.95)
                             << " degrees; positions: median " << test::median(metres) << " m; over standard errors "
                             << root_mean_square(ratios));
  CAPTURE(result.rms_px, result.error_scale);
  CHECK(test::median(degrees) <= 0.05);
  CHECK(test::percentile(degrees, 0.95) <= 0.15);
  CHECK(test::median(metres) <= 0.005);
  CHECK(root_mean_square(ratios) > 0.8);
  CHECK(root_mean_square(ratios) < 1.25);
}

}  // namespace lightstage::calib
