#include "calib/light_gain.h"

#include <catch2/catch.hpp>
#include <limits>
#include <random>

#include "calib/ball_pictures.h"
#include "core/error.h"

namespace lightstage::calib {

using core::Vec3;

namespace {

const Sphere kBall{{0.003, -0.004, 0.002}, 0.06, 0, 0};
constexpr double kAlbedo = 0.5;

core::Image coloured(const core::Image& grey, std::array<float, 3> gain) {
  core::Image image(grey.height(), grey.width(), 3);
  for (int y = 0; y < grey.height(); ++y) {
    for (int x = 0; x < grey.width(); ++x) {
      for (int c = 0; c < 3; ++c) image(y, x, c) = grey(y, x) * gain[std::size_t(c)];
    }
  }
  return image;
}

}  // namespace

TEST_CASE("the grey ball gives each light's gain, channel by channel") {
  const core::CameraModel camera = test::stage_camera(256);
  for (const Vec3 light : {Vec3{0.3, 0.4, 1.4}, Vec3{1.3, -0.5, 0.5}, Vec3{-1.2, 0.6, -0.6}}) {
    const core::Image grey = test::lambertian_ball(camera, kBall, {{light, 0.012, 1}}, kAlbedo, 0.6);
    const core::Image picture = test::through_sensor(coloured(grey, {1.3F, 0.9F, 0.7F}), 0.9, 1);
    const GainEstimate gain = estimate_gain(picture, camera, kBall, kAlbedo, light, 1 / 0.9);
    INFO(gain.reason);
    REQUIRE(gain.measured);
    CHECK(gain.gain[0] == Approx(1.3).epsilon(0.004));
    CHECK(gain.gain[1] == Approx(0.9).epsilon(0.004));
    CHECK(gain.gain[2] == Approx(0.7).epsilon(0.004));
    CHECK(gain.relative_sigma > 0);
    CHECK(gain.relative_sigma < 0.004);
    // A grey picture gives one gain to all channels.
    const GainEstimate mono = estimate_gain(test::through_sensor(grey, 0.9, 2), camera, kBall, kAlbedo, light, 1 / 0.9);
    CHECK(mono.gain[0] == Approx(1).epsilon(0.004));
    CHECK(mono.gain[0] == mono.gain[2]);
  }
}

TEST_CASE("gains are within 1 % at 40 dB, and as exact as they say, however well the lights' places are known") {
  constexpr double kSaturation = 1.25;
  const core::CameraModel camera = test::stage_camera(160);
  const std::vector<test::Lamp> lamps = test::stage_lamps(45, 1.5, 0, 4);
  const core::Image full_on = test::lambertian_ball(camera, kBall, lamps, kAlbedo, 0.5);
  const Sphere ball = locate_sphere(test::through_sensor(full_on, 0.5 / 15, 77), camera, kBall.radius_m);
  std::vector<core::Image> pictures;
  for (std::size_t i = 0; i < lamps.size(); ++i) {
    const core::Image grey = test::lambertian_ball(camera, kBall, {lamps[i]}, kAlbedo, 0.5);
    pictures.push_back(test::through_sensor(grey, 1 / kSaturation, 100 + i));
  }
  // Standard errors along the line of sight from stage centre and across it: an all-round 3 mm, and as two balls near each other leave them.
  for (const auto& [along, across] : {std::pair{0.003, 0.003}, std::pair{0.015, 0.0005}}) {
    std::mt19937 generator(11);
    std::normal_distribution<double> normal(0, 1);
    std::vector<double> errors;
    double squares = 0;
    for (std::size_t i = 0; i < lamps.size(); ++i) {
      const Vec3 sight = lamps[i].position / norm(lamps[i].position);
      const Vec3 any{normal(generator), normal(generator), normal(generator)};
      const Vec3 off = any * across + sight * (dot(any, sight) * (along - across));
      const auto row = [&, along = along, across = across](Vec3 axis) {
        return axis * (across * across) + sight * (dot(axis, sight) * (along * along - across * across));
      };
      const core::Mat3 covariance{{row({1, 0, 0}), row({0, 1, 0}), row({0, 0, 1})}};
      const GainEstimate gain =
          estimate_gain(pictures[i], camera, ball, kAlbedo, lamps[i].position + off, kSaturation, covariance);
      if (!gain.measured) continue;
      errors.push_back(std::abs(gain.gain[0] - 1));
      squares += std::pow((gain.gain[0] - 1) / gain.sigma[0], 2);
      CHECK(gain.relative_sigma == Approx(gain.sigma[0] / gain.gain[0]));
    }
    const double n = double(errors.size());
    INFO(along << " m along, " << across << " m across: " << n << " lights, median error " << test::median(errors)
               << ", 95 % " << test::percentile(errors, 0.95) << ", error over standard error "
               << std::sqrt(squares / n));
    CHECK(n >= 30);
    CHECK(test::percentile(errors, 0.95) < 0.01);
    CHECK(std::sqrt(squares / n) > 0.75);
    CHECK(std::sqrt(squares / n) < 1.3);
  }
}

TEST_CASE("a near light is seen nearer, not stronger") {
  const core::CameraModel camera = test::stage_camera(200);
  const Vec3 light{0.1, 0.1, 0.4};
  const core::Image picture = test::lambertian_ball(camera, kBall, {{light, 0.001, 0.8}}, kAlbedo, 0.4);
  CHECK(estimate_gain(picture, camera, kBall, kAlbedo, light).gain[0] == Approx(0.8).epsilon(0.003));
}

TEST_CASE("clipped pixels, a glossy spot and a label do not change the gain") {
  const core::CameraModel camera = test::stage_camera(256);
  const Vec3 light{0.5, 0.3, 1.3};
  const core::Image grey = test::lambertian_ball(camera, kBall, {{light, 0.012, 1}}, kAlbedo, 0.6);
  core::Image spotted = test::through_sensor(grey, 0.9, 1);
  for (int y = 110; y < 116; ++y) {
    for (int x = 130; x < 136; ++x) spotted(y, x) *= 2;
    for (int x = 90; x < 100; ++x) spotted(y, x) *= 0.3F;
  }
  CHECK(estimate_gain(spotted, camera, kBall, kAlbedo, light, 0).gain[0] == Approx(1).epsilon(0.005));
  // Half of the ball is brighter than the sensor's limit.
  const core::Image clipped = test::through_sensor(grey, 2.8, 1);
  CHECK(estimate_gain(clipped, camera, kBall, kAlbedo, light, 1 / 2.8).gain[0] == Approx(1).epsilon(0.005));
}

TEST_CASE("a light behind the ball, a dead one and a saturated picture are not measured") {
  const core::CameraModel camera = test::stage_camera(128);
  const Vec3 behind{0.02, 0.01, -1.5};
  const Vec3 front{0.1, 0.2, 1.4};
  core::Image picture(128, 128, 3);
  CHECK_FALSE(estimate_gain(picture, camera, kBall, kAlbedo, behind).measured);
  const GainEstimate dead = estimate_gain(test::through_sensor(picture, 1, 4), camera, kBall, kAlbedo, front);
  CHECK_FALSE(dead.measured);
  CHECK_FALSE(dead.reason.empty());
  CHECK(dead.gain == std::array<double, 3>{1, 1, 1});
  CHECK_FALSE(estimate_gain(picture, camera, kBall, kAlbedo, front).measured);
  for (float& v : picture.values()) v = -0.1F;
  CHECK_FALSE(estimate_gain(picture, camera, kBall, kAlbedo, front).measured);
  for (float& v : picture.values()) v = 1;
  CHECK_FALSE(estimate_gain(picture, camera, kBall, kAlbedo, front, 1).measured);
  CHECK_FALSE(estimate_gain(picture, camera, Sphere{{0.6, 0, 0}, 0.06, 0, 0}, kAlbedo, front, 0).measured);
}

TEST_CASE("a grey ball picture that makes no sense is refused") {
  const core::CameraModel camera = test::stage_camera(128);
  core::Image picture(128, 128, 3);
  CHECK_THROWS_AS(estimate_gain(picture, camera, kBall, 0, {0, 0, 1}), core::BadInput);
  CHECK_THROWS_AS(estimate_gain(picture, camera, kBall, kAlbedo, {0, 0, 0.01}), core::BadInput);
  const auto with = [&](core::Mat3 covariance) {
    return estimate_gain(picture, camera, kBall, kAlbedo, {0, 0, 1}, 0, covariance);
  };
  const Vec3 x{1e-6, 0, 0}, y{0, 1e-6, 0}, z{0, 0, 1e-6};
  CHECK_NOTHROW(with({{x, y, z}}));
  CHECK_THROWS_AS(with({{x, y, -z}}), core::BadInput);
  CHECK_THROWS_AS(with({{x, x, z}}), core::BadInput);
  CHECK_THROWS_AS(with({{x, y, Vec3{0, 0, std::numeric_limits<double>::infinity()}}}), core::BadInput);
  CHECK_THROWS_AS(estimate_gain(core::Image(128, 128, 2), camera, kBall, kAlbedo, {0, 0, 1}), core::BadInput);
  CHECK_THROWS_AS(estimate_gain(core::Image(127, 128, 3), camera, kBall, kAlbedo, {0, 0, 1}), core::BadInput);
  picture(1, 1, 1) = std::numeric_limits<float>::quiet_NaN();
  CHECK_THROWS_AS(estimate_gain(picture, camera, kBall, kAlbedo, {0, 0, 1}), core::BadInput);
}

}  // namespace lightstage::calib
