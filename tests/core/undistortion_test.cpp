// Undistorted pictures.
#include <catch2/catch.hpp>

#include <cmath>

#include "core/cubic_sampling.h"
#include "core/error.h"
#include "core/undistortion.h"

namespace lightstage::core {

namespace {

CameraModel lens() {
  CameraModel camera = look_at({0.1, 0.2, 1}, {0, 0, 0}, 160, 120, 50);
  camera.cx += 3;
  camera.k1 = -0.25;
  camera.k2 = 0.12;
  camera.k3 = -0.02;
  camera.p1 = 0.002;
  camera.p2 = -0.001;
  return camera;
}

// A smooth scene over the viewing direction.
float scene(Vec3 ray) {
  const double x = ray.x / ray.z, y = ray.y / ray.z;
  return float(0.5 + 0.25 * std::sin(22 * x) + 0.2 * std::cos(18 * y + 5 * x));
}

core::Image taken_by(const CameraModel& camera) {
  Image picture(camera.height, camera.width, 2);
  for (int y = 0; y < camera.height; ++y) {
    for (int x = 0; x < camera.width; ++x) {
      picture(y, x, 0) = scene(camera.ray_in_camera({double(x), double(y)}));
      picture(y, x, 1) = 1 - picture(y, x, 0);
    }
  }
  return picture;
}

}  // namespace

TEST_CASE("an undistorted picture is what a pinhole camera takes, and nothing is invented beyond the lens's view") {
  const CameraModel camera = lens(), pinhole = pinhole_of(camera);
  const Undistorted result = undistort(taken_by(camera), camera);
  const Image truth = taken_by(pinhole);
  int seen = 0, unseen = 0;
  for (int y = 0; y < camera.height; ++y) {
    for (int x = 0; x < camera.width; ++x) {
      const Pixel place = *camera.project(camera.centre() + pinhole.ray({double(x), double(y)}));
      const bool inside = place.x >= -0.5 && place.y >= -0.5 && place.x <= 159.5 && place.y <= 119.5;
      REQUIRE(result.mask(y, x) == (inside ? 1 : 0));
      // Beyond the border the last pixels repeat: compare where the cubic has its sixteen.
      const bool whole = place.x >= 1 && place.y >= 1 && place.x <= 158 && place.y <= 118;
      for (int c = 0; c < 2; ++c) {
        if (!inside) REQUIRE(result.picture(y, x, c) == 0);
        if (whole) REQUIRE(result.picture(y, x, c) == Approx(truth(y, x, c)).margin(0.004));
      }
      (inside ? seen : unseen)++;
    }
  }
  CHECK(seen > 15000);

  // A wider pinhole sees past the picture's border.
  CameraModel wide = pinhole;
  wide.fx /= 2;
  wide.fy /= 2;
  const Undistorted beyond = undistort(taken_by(camera), camera, wide);
  CHECK(beyond.mask(0, 0) == 0);
  CHECK(beyond.picture(0, 0) == 0);
  CHECK(beyond.mask(60, 80) == 1);
}

TEST_CASE("the undistortion map is the lens's own projection, also where it folds") {
  const CameraModel camera = lens();
  const Image map = undistortion_map(camera, pinhole_of(camera));
  for (int y = 0; y < 120; y += 7) {
    for (int x = 0; x < 160; x += 7) {
      if (std::isnan(map(y, x, 0))) continue;
      const Vec3 back = camera.ray_in_camera({double(map(y, x, 0)), double(map(y, x, 1))});
      const Vec3 ray = pinhole_of(camera).ray_in_camera({double(x), double(y)});
      CHECK(norm(back - ray) < 1e-6);
    }
  }
  // A barrel so strong that rays further out come back into the picture: they are not shown twice.
  CameraModel fold = lens();
  fold.k1 = -0.6;
  fold.k2 = fold.k3 = 0;
  CameraModel wide = pinhole_of(fold);
  wide.fx = wide.fy = 40;
  const Image folded = undistortion_map(fold, wide);
  for (int x = 0; x < wide.width; ++x) {
    const Vec3 ray = wide.ray_in_camera({double(x), wide.cy});
    const double r = std::abs(ray.x / ray.z);
    // The distortion's slope 1 + 3 k1 r^2 changes sign here.
    if (r > 1.02 * std::sqrt(1 / 1.8)) CHECK(std::isnan(folded(int(wide.cy), x, 0)));
  }
}

TEST_CASE("without distortion nothing changes; wrong sizes and values are refused") {
  const CameraModel pinhole = pinhole_of(lens());
  const Image picture = taken_by(pinhole);
  const Undistorted same = undistort(picture, pinhole);
  double largest = 0;
  for (std::size_t i = 0; i < picture.values().size(); ++i) {
    largest = std::max(largest, std::abs(double(picture.values()[i] - same.picture.values()[i])));
  }
  CHECK(largest < 1e-5);
  CHECK_THROWS_AS(undistort(Image(10, 10, 1), pinhole), BadInput);
  CHECK_THROWS_AS(undistort(picture, pinhole, lens()), BadInput);
  Image bad = picture;
  bad(3, 3) = NAN;
  CHECK_THROWS_AS(undistort(bad, pinhole), BadInput);
}

}  // namespace lightstage::core
