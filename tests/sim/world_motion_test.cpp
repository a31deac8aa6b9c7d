#include <catch2/catch.hpp>

#include "sim/scene/motion.h"
#include "support/support.h"
#include "world_scene.h"

using namespace lightstage;
using core::kSecond;
using sim::SubjectKind;
using sim::World;

namespace {

double angle_of(const core::Mat3& r) {
  const double trace = r.rows[0].x + r.rows[1].y + r.rows[2].z;
  return std::acos(std::clamp((trace - 1) / 2, -1.0, 1.0));
}

// Bilinear; NaN outside.
float look_up(const core::Image& image, double x, double y, int c) {
  const int x0 = int(std::floor(x)), y0 = int(std::floor(y));
  if (x0 < 0 || y0 < 0 || x0 + 1 >= image.width() || y0 + 1 >= image.height()) return NAN;
  const float a = float(x - x0), b = float(y - y0);
  return (image(y0, x0, c) * (1 - a) + image(y0, x0 + 1, c) * a) * (1 - b) +
         (image(y0 + 1, x0, c) * (1 - a) + image(y0 + 1, x0 + 1, c) * a) * b;
}

}  // namespace

TEST_CASE("motion is smooth, bounded by its amplitudes, and nearly uses them") {
  const sim::MotionSpec spec{.amplitude_m = 0.004, .rotation_degrees = 0.6};
  for (const std::uint64_t seed : {1u, 2u, 3u}) {
    const sim::Motion motion(spec, {}, seed);
    double farthest = 0, widest = 0, fastest = 0;
    core::RigidTransform before = motion.stage_from_subject(0);
    for (int step = 1; step <= 2000; ++step) {
      const core::RigidTransform now = motion.stage_from_subject(step * kSecond / 100);
      farthest = std::max(farthest, core::norm(now.translation));
      widest = std::max(widest, angle_of(now.rotation));
      fastest = std::max(fastest, core::norm(now.translation - before.translation) * 100);
      before = now;
    }
    CHECK(farthest <= 0.004);
    CHECK(farthest > 0.002);
    CHECK(widest <= core::radians_from_degrees(0.6) * 1.0001);
    CHECK(widest > core::radians_from_degrees(0.3));
    CHECK(fastest < 0.006);  // metres a second
  }
}

TEST_CASE("without amplitude nothing moves at all, and balls never do") {
  sim::Simulation still = test::still_simulation(SubjectKind::kProceduralHead, 3, 24);
  const World head(still);
  const capture::LightLevel level{0};
  CHECK(head.render(test::camera_of(head), {&level, 1}, 0) ==
        head.render(test::camera_of(head), {&level, 1}, 5 * kSecond));
  for (const SubjectKind kind : {SubjectKind::kMirrorBall, SubjectKind::kGreyBall}) {
    sim::Simulation simulation = test::still_simulation(kind, 3, 24);
    simulation.motion = {.amplitude_m = 0.05, .rotation_degrees = 5};
    const World world(simulation);
    const core::Image flow = world.true_flow(test::camera_of(world), 0, 5 * kSecond);
    int seen = 0;
    for (const float v : flow.values()) {
      if (std::isnan(v)) continue;
      CHECK(v == 0);
      ++seen;
    }
    CHECK(seen > 20);
  }
}

TEST_CASE("a chessboard is held still for a second, then in another pose") {
  sim::Simulation simulation = test::still_simulation(SubjectKind::kChessboard, 3, 24);
  simulation.motion.amplitude_m = 0.004;
  const World world(simulation);
  const auto longest = [&](core::Nanoseconds from, core::Nanoseconds to) {
    double result = 0;
    const core::Image flow = world.true_flow(test::camera_of(world), from, to);
    for (const float v : flow.values()) {
      if (!std::isnan(v)) result = std::max(result, std::abs(double(v)));
    }
    return result;
  };
  CHECK(longest(kSecond / 100, kSecond * 99 / 100) == 0);
  CHECK(longest(kSecond / 2, kSecond * 3 / 2) > 0.5);
}

TEST_CASE("the true flow is the projected motion of the point seen") {
  const test::TemporaryFolder folder;
  test::write_wall_and_plate(folder / "wall.obj", 0.05);
  sim::Simulation simulation = test::still_simulation(SubjectKind::kMesh, 3, 48);
  simulation.subject.mesh_path = (folder / "wall.obj").string();
  simulation.subject.size_m = 0.24;
  simulation.subject.yaw_degrees = 20;
  simulation.motion = {.amplitude_m = 0.01, .rotation_degrees = 3};
  simulation.seed = 9;
  const World world(simulation);
  const core::CameraModel& camera = test::camera_of(world);
  const sim::Motion motion(simulation.motion, {.yaw_degrees = 20}, 9);
  const core::RigidTransform from = motion.stage_from_subject(kSecond), to = motion.stage_from_subject(4 * kSecond);
  const core::Image flow = world.true_flow(camera, kSecond, 4 * kSecond);
  int seen = 0, moved = 0;
  for (int y = 0; y < 48; ++y) {
    for (int x = 0; x < 48; ++x) {
      // The wall's plane is z = -0.025 of the subject, the plate's z = 0.025: a ray meets the plate first.
      const core::RigidTransform back = from.inverse();
      const core::Vec3 origin = back.apply(camera.centre()), ray = back.rotation * camera.ray({double(x), double(y)});
      std::optional<core::Vec3> point;
      for (const auto& [z, half] : {std::pair{0.025, 0.03}, {-0.025, 0.12}}) {
        const core::Vec3 hit = origin + ray * ((z - origin.z) / ray.z);
        if (!point && std::max(std::abs(hit.x), std::abs(hit.y)) < half) point = hit;
      }
      const bool is_nan = std::isnan(flow(y, x, 0));
      CHECK(is_nan == !point.has_value());
      if (!point || is_nan) continue;
      const core::Pixel end = *camera.project(to.apply(*point));
      CHECK(double(flow(y, x, 0)) == Approx(end.x - x).margin(1e-3));
      CHECK(double(flow(y, x, 1)) == Approx(end.y - y).margin(1e-3));
      ++seen;
      if (std::hypot(flow(y, x, 0), flow(y, x, 1)) > 0.5) ++moved;
    }
  }
  CHECK(seen > 500);
  CHECK(moved > seen / 2);
}

TEST_CASE("pictures move as the flow says, by a few pixels") {
  sim::Simulation simulation = test::still_simulation(SubjectKind::kProceduralHead, 40, 128);
  simulation.motion = {.amplitude_m = 0.006, .rotation_degrees = 1};
  const World world(simulation);
  const core::CameraModel& camera = test::camera_of(world);
  const std::vector<capture::LightLevel> levels = test::all_lights(world);
  const core::Image first = world.render(camera, levels, 0), second = world.render(camera, levels, 3 * kSecond);
  const core::Image flow = world.true_flow(camera, 0, 3 * kSecond);
  double still = 0, warped = 0, length = 0;
  int pixels = 0;
  for (int y = 0; y < 128; ++y) {
    for (int x = 0; x < 128; ++x) {
      if (std::isnan(flow(y, x, 0))) continue;
      const double dx = double(flow(y, x, 0)), dy = double(flow(y, x, 1));
      const float there = look_up(second, x + dx, y + dy, 1);
      if (std::isnan(there)) continue;
      still += std::pow(double(second(y, x, 1)) - double(first(y, x, 1)), 2);
      warped += std::pow(double(there) - double(first(y, x, 1)), 2);
      length += std::hypot(dx, dy);
      ++pixels;
    }
  }
  REQUIRE(pixels > 1000);
  CHECK(length / pixels > 1);
  CHECK(length / pixels < 12);
  CHECK(warped < 0.2 * still);
}
