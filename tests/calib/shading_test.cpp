// What a grey ball tells of a light that is known.
#include "calib/shading.h"

#include <catch2/catch.hpp>

#include "calib/ball_pictures.h"
#include "core/direction.h"
#include "core/error.h"

namespace lightstage::calib {

using core::Vec3;

namespace {

const Sphere kBall{{0.003, -0.004, 0.002}, 0.06, 0, 0};
constexpr double kAlbedo = 0.5;

core::Image picture_of(const core::CameraModel& camera, Vec3 light, std::array<float, 3> gain, std::uint64_t seed) {
  const core::Image grey = test::lambertian_ball(camera, kBall, {{light, 0.012, 1}}, kAlbedo, 0.6);
  core::Image image(grey.height(), grey.width(), 3);
  for (int y = 0; y < grey.height(); ++y) {
    for (int x = 0; x < grey.width(); ++x) {
      for (int c = 0; c < 3; ++c) image(y, x, c) = grey(y, x) * gain[std::size_t(c)];
    }
  }
  return test::through_sensor(image, 0.9, seed);
}

}  // namespace

TEST_CASE("a light that is as it was calibrated leaves only noise") {
  const core::CameraModel camera = test::stage_camera(256);
  std::vector<double> turned;
  for (const Vec3 light : {Vec3{0.3, 0.4, 1.4}, Vec3{1.3, -0.5, 0.5}, Vec3{-1.2, 0.6, -0.6}}) {
    for (std::uint64_t seed = 1; seed <= 6; ++seed) {
      const core::Image picture = picture_of(camera, light, {1.3F, 0.9F, 0.7F}, seed);
      const ShadingResidual found = compare_shading(picture, camera, kBall, kAlbedo, {light, {1.3, 0.9, 0.7}}, 1 / 0.9);
      INFO(found.reason);
      REQUIRE(found.compared);
      for (const double ratio : found.gain_ratio) CHECK(std::abs(ratio - 1) < 0.005);
      CHECK(found.degrees < 0.2);
      CHECK(found.residual < 0.05);
      turned.push_back(found.degrees / found.degrees_sigma);
    }
  }
  CHECK(test::median(turned) < 2);
}

TEST_CASE("a light that turned or changed its brightness or colour shows by how much") {
  const core::CameraModel camera = test::stage_camera(256);
  const Vec3 before{0.5, 0.4, 1.3};
  const Vec3 axis = cross(before, Vec3{0, 1, 0});
  const Vec3 after = core::rotation_about(axis, core::radians_from_degrees(2)) * before;
  const ShadingResidual moved =
      compare_shading(picture_of(camera, after, {1, 1, 1}, 3), camera, kBall, kAlbedo, {before, {1, 1, 1}}, 1 / 0.9);
  REQUIRE(moved.compared);
  CHECK(moved.degrees == Approx(2).margin(0.2));
  for (const double ratio : moved.gain_ratio) CHECK(ratio == Approx(1).margin(0.01));

  const ShadingResidual dimmed = compare_shading(picture_of(camera, before, {0.88F, 0.8F, 0.8F}, 4), camera, kBall,
                                                 kAlbedo, {before, {1, 1, 0.8}}, 1 / 0.9);
  REQUIRE(dimmed.compared);
  CHECK(dimmed.degrees < 0.2);
  CHECK(dimmed.gain_ratio[0] == Approx(0.88).epsilon(0.005));
  CHECK(dimmed.gain_ratio[1] == Approx(0.8).epsilon(0.005));
  CHECK(dimmed.gain_ratio[2] == Approx(1).epsilon(0.005));
  CHECK(dimmed.residual == Approx(0.14).margin(0.03));
}

TEST_CASE("a dark ball, a grey picture, and one that shows too little") {
  const core::CameraModel camera = test::stage_camera(256);
  const Vec3 light{0.3, 0.4, 1.4};
  const ShadingResidual dark =
      compare_shading(picture_of(camera, light, {0, 0, 0}, 5), camera, kBall, kAlbedo, {light, {1, 1, 1}}, 1 / 0.9);
  REQUIRE(dark.compared);
  CHECK(dark.gain_ratio[1] == 0);
  CHECK(dark.degrees_sigma == 180);

  const core::Image grey = test::lambertian_ball(camera, kBall, {{light, 0.012, 1}}, kAlbedo, 0.6);
  const ShadingResidual one = compare_shading(grey, camera, kBall, kAlbedo, {light, {1.1, 1, 0.9}});
  REQUIRE(one.compared);
  CHECK(one.gain_ratio[2] == Approx(1).epsilon(0.005));

  const ShadingResidual behind = compare_shading(grey, camera, kBall, kAlbedo, {{0, 0.01, -1.5}, {1, 1, 1}});
  CHECK_FALSE(behind.compared);
  CHECK(behind.reason.find("pixels") != std::string::npos);
  const ShadingResidual dead = compare_shading(grey, camera, kBall, kAlbedo, {light, {0, 0, 0}});
  CHECK_FALSE(dead.compared);
  CHECK_THROWS_AS(compare_shading(grey, camera, kBall, 0, {light, {1, 1, 1}}), core::BadInput);
  CHECK_THROWS_AS(compare_shading(grey, camera, kBall, kAlbedo, {kBall.centre, {1, 1, 1}}), core::BadInput);
}

}  // namespace lightstage::calib
