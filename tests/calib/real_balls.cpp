// Photographs of real balls.
#include <array>
#include <catch2/catch.hpp>
#include <fstream>

#include "calib/ball_pictures.h"
#include "calib/mirror_ball.h"
#include "core/image_file.h"
#include "support/support.h"
#include <iostream>

namespace lightstage::calib {

namespace {

constexpr double kFar = 1e4;  // in ball radii: a camera or light so far away sees parallel rays

// A camera that sees a ball of unit radius at the stage centre as a circle, as nearly parallel as one likes.
core::CameraModel distant_camera(int width, int height, core::Pixel centre, double radius_px) {
  core::CameraModel camera = core::look_at({0, 0, kFar}, {0, 0, 0}, width, height, 1);
  camera.fx = camera.fy = radius_px * kFar;
  camera.cx = centre.x;
  camera.cy = centre.y;
  return camera;
}

const Sphere kUnitBall{{0, 0, 0}, 1, 0, 0};

std::string numbered(int n, std::size_t digits) {
  std::string text = std::to_string(n);
  text.insert(0, digits - text.size(), '0');
  return text;
}

}  // namespace

TEST_CASE("highlights on a photographed glossy ball agree with its known lights") {
  const auto folder = test::real_data("diligent_ball16");
  if (folder.empty()) SKIP_TEST("no real data (diligent_ball16)");
  const core::CameraModel camera = distant_camera(212, 196, {105.5, 97.5}, 71.0);
  std::ifstream directions(folder / "light_directions.txt");
  std::vector<double> errors;
  for (int i = 0; i < 96; ++i) {
    core::Vec3 truth;
    REQUIRE(directions >> truth.x >> truth.y >> truth.z);
    const std::string name = numbered(i + 1, 3).append(".png");
    core::Image image = core::read_image(folder / name, {core::Encoding::kLinear});
    const LightEstimate light = estimate_light({i, std::move(image), 1}, camera, kUnitBall, kFar);
    INFO(name << ": " << light.reason);
    REQUIRE(light.placed);
    errors.push_back(test::degrees_between(light.position, truth));
    std::cout << i << " " << errors.back() << " sigma " << light.sigma_degrees << " d " << (light.direction.vec()-truth).x << " " << (light.direction.vec()-truth).y << "\n";
  }
  double sum = 0;
  for (const double e : errors) sum += e;
  std::cout << "diligent mean " << sum / 96 << " max " << test::percentile(errors, 1) << "\n";
  CHECK(sum / double(errors.size()) < 1.13);
}

TEST_CASE("two photographed mirror balls see the same lights") {
  const auto folder = test::real_data("psbox_two_mirror_balls/data");
  if (folder.empty()) SKIP_TEST("no real data (psbox_two_mirror_balls)");
  std::vector<std::vector<LightEstimate>> balls;
  for (const std::string ball : {"LightProbe-1", "LightProbe-2"}) {
    std::ifstream circle(folder / ball / "circle_data.txt");
    double x = 0, y_from_bottom = 0, radius = 0;
    REQUIRE(circle >> x >> y_from_bottom >> radius);
    std::vector<LightEstimate> lights;
    for (int i = 1; i <= 12; ++i) {
      core::Image image = core::read_image(folder / ball / std::string("Image_").append(numbered(i, 2)).append(".JPG"));
      // Both counts start at 1.
      const core::Pixel centre{x - 1, image.height() - y_from_bottom};
      const core::CameraModel camera = distant_camera(image.width(), image.height(), centre, radius);
      lights.push_back(estimate_light({i, std::move(image), 1}, camera, kUnitBall, kFar));
      INFO(ball << " image " << i << ": " << lights.back().reason);
      CHECK(lights.back().placed);
    }
    balls.push_back(std::move(lights));
  }
  double sum = 0;
  for (std::size_t i = 0; i < 12; ++i) {
    std::cout << "psbox " << i << " " << test::degrees_between(balls[0][i].position, balls[1][i].position) << " " << balls[0][i].sigma_degrees << " " << balls[1][i].sigma_degrees<< "\n";
    sum += test::degrees_between(balls[0][i].position, balls[1][i].position);
  }
  std::cout << "mean " << sum / 12 << "\n";
  CHECK(sum / 12 < 0.95);
}

}  // namespace lightstage::calib
