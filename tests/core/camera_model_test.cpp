#include "core/camera_model.h"

#include <catch2/catch.hpp>
#include <cmath>

#include "core/direction.h"
#include "core/error.h"

using namespace lightstage;
using core::CameraModel;
using core::Vec3;

namespace {

CameraModel distorted_camera() {
  CameraModel camera = core::look_at({0.3, 0.2, 2.5}, {0, 0.1, 0}, 1021, 767, 40);
  camera.k1 = -0.21;
  camera.k2 = 0.09;
  camera.k3 = -0.01;
  camera.p1 = 0.0013;
  camera.p2 = -0.0008;
  camera.cx += 7.3;
  camera.fy *= 1.01;
  return camera;
}

}  // namespace

TEST_CASE("a camera on +z sees stage x to the right and stage y up") {
  const CameraModel camera = core::look_at({0, 0, 3}, {0, 0, 0}, 200, 100, 60);
  const core::Pixel centre = camera.project({0, 0, 0}).value();
  CHECK(centre.x == Approx(99.5));
  CHECK(centre.y == Approx(49.5));
  CHECK(camera.project({0.5, 0, 0})->x > 99.5);
  CHECK(camera.project({0, 0.5, 0})->y < 49.5);
  // The horizontal field of view ends at the outer edges of the outermost pixels.
  const double half = 3 * std::tan(core::radians_from_degrees(30));
  CHECK(camera.project({half, 0, 0})->x == Approx(199.5));
  CHECK(camera.project({-half, 0, 0})->x == Approx(-0.5));
}

TEST_CASE("what lies on or behind the camera plane is not seen") {
  const CameraModel camera = core::look_at({0, 0, 3}, {0, 0, 0}, 200, 100, 60);
  CHECK_FALSE(camera.project({0, 0, 3}).has_value());
  CHECK_FALSE(camera.project({1, 0, 3}).has_value());
  CHECK_FALSE(camera.project({0, 0, 4}).has_value());
}

TEST_CASE("the viewing ray of a pixel runs through the points seen in it") {
  const CameraModel camera = distorted_camera();
  for (double x = -0.5; x <= camera.width; x += 51.1)
    for (double y = -0.5; y <= camera.height; y += 47.9) {
      const Vec3 ray = camera.ray({x, y});
      CHECK(core::norm(ray) == Approx(1).epsilon(1e-14));
      for (const double distance : {0.01, 2.0, 1e6}) {
        const auto seen = camera.project(camera.centre() + distance * ray);
        REQUIRE(seen.has_value());
        CHECK(std::hypot(seen->x - x, seen->y - y) < 1e-8);
      }
    }
}

TEST_CASE("distortion follows Brown-Conrady in OpenCV's order of coefficients") {
  CameraModel camera;
  camera.width = camera.height = 100;
  camera.fx = camera.fy = 1;
  camera.k1 = 0.1;
  camera.k2 = 0.01;
  camera.k3 = 0.001;
  camera.p1 = 0.02;
  camera.p2 = 0.03;
  // By hand at x = 0.5, y = -0.25: r^2 = 0.3125.
  const double r2 = 0.3125;
  const double radial = 1 + 0.1 * r2 + 0.01 * r2 * r2 + 0.001 * r2 * r2 * r2;
  const core::Pixel seen = camera.project({1, -0.5, 2}).value();
  CHECK(seen.x == Approx(0.5 * radial + 2 * 0.02 * 0.5 * -0.25 + 0.03 * (r2 + 2 * 0.25)).epsilon(1e-14));
  CHECK(seen.y == Approx(-0.25 * radial + 0.02 * (r2 + 2 * 0.0625) + 2 * 0.03 * 0.5 * -0.25).epsilon(1e-14));
}

TEST_CASE("a pixel that no ray reaches is refused, not guessed") {
  CameraModel camera = core::look_at({0, 0, 3}, {0, 0, 0}, 200, 100, 60);
  camera.k1 = -0.3;  // folds at r = 1 / sqrt(0.9), where the distorted radius is at most 0.703
  CHECK_NOTHROW(camera.ray({camera.cx + 0.70 * camera.fx, camera.cy}));
  CHECK_THROWS_AS(camera.ray({camera.cx + 0.71 * camera.fx, camera.cy}), core::BadInput);
}

TEST_CASE("a camera needs somewhere to look and an image") {
  CHECK_THROWS_AS(core::look_at({1, 1, 1}, {1, 1, 1}, 10, 10, 50), core::BadInput);
  CHECK_THROWS_AS(core::look_at({0, 2, 0}, {0, 0, 0}, 10, 10, 50), core::BadInput);
  CHECK_THROWS_AS(core::look_at({0, 0, 2}, {0, 0, 0}, 0, 10, 50), core::BadInput);
  for (const double degrees : {0.0, 180.0, -3.0, std::nan("")})
    CHECK_THROWS_AS(core::look_at({0, 0, 2}, {0, 0, 0}, 10, 10, degrees), core::BadInput);
}
