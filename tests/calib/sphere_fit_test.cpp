#include "calib/sphere_fit.h"

#include <catch2/catch.hpp>
#include <limits>

#include "calib/ball_pictures.h"
#include "core/error.h"

namespace lightstage::calib {

using core::Vec3;

namespace {

// How far off the ball's image would be, in pixels: sideways, and in radius.
struct OutlineError {
  double sideways = 0, radius = 0;
};

OutlineError outline_error(const core::CameraModel& camera, const Sphere& found, const Sphere& truth) {
  const double distance = norm(truth.centre - camera.centre());
  const double px_per_metre = camera.fx / distance;
  const Vec3 sight = (truth.centre - camera.centre()) / distance;
  const Vec3 off = found.centre - truth.centre;
  const double along = dot(off, sight);
  return {norm(off - sight * along) * px_per_metre, std::abs(along / distance) * truth.radius_m * px_per_metre};
}

}  // namespace

TEST_CASE("a ball's outline gives its place to a few hundredths of a pixel") {
  for (const int pixels : {128, 257}) {
    for (const double blur : {0.4, 0.8, 1.5}) {
      const core::CameraModel camera = test::stage_camera(pixels);
      // Off the axis, where its image is no circle.
      for (const Vec3 centre : {Vec3{0, 0, 0}, Vec3{0.05, -0.08, 0.1}}) {
        const Sphere truth{centre, 0.06, 0, 0};
        const core::Image picture = test::lambertian_ball(camera, truth, test::stage_lamps(24, 1.5, 1, 5), 0.4, blur);
        const Sphere found = locate_sphere(test::through_sensor(picture, 0.08, 1), camera, 0.06);
        const OutlineError error = outline_error(camera, found, truth);
        INFO(pixels << " pixels, blur " << blur << ": sideways " << error.sideways << ", radius " << error.radius);
        CHECK(error.sideways < 0.05);
        CHECK(error.radius < 0.08);
        CHECK(found.radius_m == 0.06);
        CHECK(found.outline_points > 100);
      }
    }
  }
}

TEST_CASE("a ball lit from the front, dark at its rim, is not taken for smaller") {
  const core::CameraModel camera = test::stage_camera(400);
  const Sphere truth{{0.01, 0.02, 0}, 0.06, 0, 0};
  std::vector<test::Lamp> front;
  for (const test::Lamp& lamp : test::stage_lamps(80, 1.5, 0, 1)) {
    if (lamp.position.z > 0) front.push_back(lamp);
  }
  const core::Image picture = test::lambertian_ball(camera, truth, front, 0.5, 0.7);
  const Sphere found = locate_sphere(test::through_sensor(picture, 0.05, 1), camera, 0.06);
  const OutlineError error = outline_error(camera, found, truth);
  CHECK(error.sideways < 0.1);
  CHECK(error.radius < 0.15);
}

TEST_CASE("lamps reflected near the rim do not bend the outline") {
  const core::CameraModel camera = test::stage_camera(512);
  const Sphere truth{{0.004, -0.003, 0.005}, 0.06, 0, 0};
  const auto lamps = test::stage_lamps(180, 1.5, 1, 3);
  const core::Image picture = test::sum(test::lambertian_ball(camera, truth, lamps, 0.01, 0.5),
                                        test::mirror_reflections(camera, truth, lamps, 0.5));
  const Sphere found = locate_sphere(test::through_sensor(picture, 0.045, 1), camera, 0.06);
  const OutlineError error = outline_error(camera, found, truth);
  CHECK(error.sideways < 0.03);
  CHECK(error.radius < 0.05);
}

TEST_CASE("a ball on a stand, and one cut by the picture's border, are found") {
  const core::CameraModel camera = test::stage_camera(300);
  const auto lamps = test::stage_lamps(60, 1.5, 1, 5);
  const Sphere truth{{0, 0.02, 0}, 0.06, 0, 0};
  core::Image picture = test::lambertian_ball(camera, truth, lamps, 0.4, 0.6);
  for (int y = 180; y < 300; ++y) {
    for (int x = 140; x < 162; ++x) picture(y, x) = 6.0F;
  }
  const Sphere found = locate_sphere(test::through_sensor(picture, 0.08, 1), camera, 0.06);
  CHECK(outline_error(camera, found, truth).sideways < 0.05);

  const Sphere at_border{{0.13, 0, 0}, 0.06, 0, 0};
  const core::Image cut = test::through_sensor(test::lambertian_ball(camera, at_border, lamps, 0.4, 0.6), 0.08, 1);
  const OutlineError error = outline_error(camera, locate_sphere(cut, camera, 0.06), at_border);
  CHECK(error.sideways < 0.1);
  CHECK(error.radius < 0.1);

  const Sphere half_out{{0.167, 0, 0}, 0.06, 0, 0};
  const core::Image gone = test::through_sensor(test::lambertian_ball(camera, half_out, lamps, 0.4, 0.6), 0.08, 1);
  CHECK_THROWS_AS(locate_sphere(gone, camera, 0.06), core::BadInput);
}

TEST_CASE("what is no ball is refused") {
  const core::CameraModel camera = test::stage_camera(200);
  core::Image picture(200, 200, 1);
  CHECK_THROWS_AS(locate_sphere(picture, camera, 0.06), core::BadInput);
  CHECK_THROWS_AS(locate_sphere(test::through_sensor(picture, 1, 1), camera, 0.06), core::BadInput);
  for (float& v : picture.values()) v = 1;
  CHECK_THROWS_AS(locate_sphere(picture, camera, 0.06), core::BadInput);
  picture = core::Image(200, 200, 1);
  for (int y = 50; y < 150; ++y) {
    for (int x = 30; x < 170; ++x) picture(y, x) = 1;
  }
  CHECK_THROWS_AS(locate_sphere(picture, camera, 0.06), core::BadInput);
  picture = core::Image(200, 200, 1);
  for (int y = 98; y < 103; ++y) {
    for (int x = 98; x < 103; ++x) picture(y, x) = 1;
  }
  CHECK_THROWS_AS(locate_sphere(picture, camera, 0.06), core::BadInput);
  CHECK_THROWS_AS(locate_sphere(core::Image(200, 199, 1), camera, 0.06), core::BadInput);
  picture(0, 0) = std::numeric_limits<float>::infinity();
  CHECK_THROWS_AS(locate_sphere(picture, camera, 0.06), core::BadInput);
  CHECK_THROWS_AS(locate_sphere(core::Image(200, 200, 1), camera, 0), core::BadInput);
  CHECK_THROWS_AS(locate_sphere(core::Image(3, 3, 1), test::stage_camera(3), 0.06), core::BadInput);
}

}  // namespace lightstage::calib
