// The subject under spherical colour gradients, summed of one-light pictures.
#include <catch2/catch.hpp>
#include <numbers>

#include "core/parallel.h"
#include "core/sphere.h"
#include "model/colour_gradients.h"
#include "model/synthetic_scan.h"

namespace lightstage {
namespace {

using core::Direction;
using core::Image;

std::vector<Direction> octahedron() {
  std::vector<Direction> lights;
  for (const double sign : {1.0, -1.0}) {
    lights.push_back(Direction::from_vector({sign, 0, 0}));
    lights.push_back(Direction::from_vector({0, sign, 0}));
    lights.push_back(Direction::from_vector({0, 0, sign}));
  }
  return lights;
}

}  // namespace

TEST_CASE("six lights of known brightness give the gradients that were computed by hand") {
  // +x, +y, +z, -x, -y, -z shine on a pixel with 1, 2, 4, 8, 16, 32. Each has a sixth of the sphere, 2/3 of pi. Red of the first gradient is
  // 2/3 (1 * 1 + 8 * 0 + (2 + 4 + 16 + 32) / 2) = 56/3, and so on.
  const auto lights = octahedron();
  const auto value = [&](const Direction& light, int, int, int) {
    for (std::size_t i = 0; i < lights.size(); ++i) {
      if (angle_radians(light, lights[i]) < 0.1) return double(1 << i);
    }
    return 0.0;
  };
  for (const int channels : {1, 3}) {
    const auto [positive, negative] = model::colour_gradients(test::scan_of(lights, {1, 2, channels}, value));
    REQUIRE((positive.size() == core::ImageSize{1, 2, 3}));
    const double sixth = 2.0 / 3;
    CHECK(positive(0, 1, 0) == Approx(sixth * (1 + (2 + 4 + 16 + 32) / 2.0)).epsilon(2e-3));
    CHECK(positive(0, 1, 1) == Approx(sixth * (2 + (1 + 4 + 8 + 32) / 2.0)).epsilon(2e-3));
    CHECK(positive(0, 1, 2) == Approx(sixth * (4 + (1 + 2 + 8 + 16) / 2.0)).epsilon(2e-3));
    CHECK(negative(0, 1, 0) == Approx(sixth * (8 + (2 + 4 + 16 + 32) / 2.0)).epsilon(2e-3));
    CHECK(negative(0, 1, 1) == Approx(sixth * (16 + (1 + 4 + 8 + 32) / 2.0)).epsilon(2e-3));
    CHECK(negative(0, 1, 2) == Approx(sixth * (32 + (1 + 2 + 8 + 16) / 2.0)).epsilon(2e-3));
  }
}

TEST_CASE("the gradients tell a matt surface's normal and albedo, whatever the layout of the stage") {
  // Under (1 + l) / 2 a matt surface of albedo a and normal n has radiance a (1 + 2/3 n) / 2 (the integral of a cosine lobe over the gradient).
  const core::ImageSize size{9, 9, 3};
  std::vector<Direction> uneven;  // twice as dense about the x axis as across it
  for (const Direction& d : core::fibonacci_directions(400)) {
    uneven.push_back(Direction::from_vector({1.3 * d.x(), d.y(), d.z()}));
  }
  for (const auto& lights : {core::fibonacci_directions(300), uneven}) {
    const auto [positive, negative] = model::colour_gradients(test::scan_of(lights, size, test::matt_ball(size)));
    for (const auto& [y, x] : {std::pair(4, 4), {4, 7}, {2, 3}, {6, 6}}) {
      const double px = (2.0 * x + 1 - 9) / 9, py = (9 - 2.0 * y - 1) / 9;
      const std::array<double, 3> normal{px, py, std::sqrt(1 - px * px - py * py)};
      for (int c = 0; c < 3; ++c) {
        const double albedo = 0.9 - 0.25 * c;
        CHECK(positive(y, x, c) == Approx(albedo * (1 + 2.0 / 3 * normal[std::size_t(c)]) / 2).epsilon(0.03));
        CHECK(positive(y, x, c) + negative(y, x, c) == Approx(albedo).epsilon(0.03));
      }
    }
  }
}

TEST_CASE("lights at the rim of a hole do not fill it") {
  std::vector<Direction> dome;
  for (const Direction& d : core::fibonacci_directions(200)) {
    if (d.z() > 0) dome.push_back(d);
  }
  const auto weights = model::colour_gradient_weights(dome);
  double sum = 0, largest = 0;
  for (std::size_t i = 0; i < dome.size(); ++i) {
    const core::Vec3 both = weights[0][i] + weights[1][i];
    CHECK(both.x == Approx(both.z));
    sum += both.x;
    largest = std::max(largest, both.x);
  }
  CHECK(sum > 2);  // half a sphere, of 4, and
  CHECK(sum < 2.5);
  CHECK(largest < 2.1 * sum / double(dome.size()));
}

TEST_CASE("gradients are finite at extremes and the same for every thread count") {
  const std::vector<Direction> one(1), same(3);
  for (const auto& lights : {one, same, core::fibonacci_directions(2), core::fibonacci_directions(40)}) {
    const auto scan = test::scan_of(
        lights, {3, 5, 3}, [](const Direction& l, int y, int, int) { return y == 1 ? 1e5 : 0.3 + 0.2 * l.x(); });
    core::set_thread_count(1);
    const auto alone = model::colour_gradients(scan);
    core::set_thread_count(3);
    CHECK(model::colour_gradients(scan) == alone);
    core::set_thread_count(0);
    for (const Image& image : alone) {
      for (const float v : image.values()) CHECK(std::isfinite(v));
    }
  }
}

}  // namespace lightstage
