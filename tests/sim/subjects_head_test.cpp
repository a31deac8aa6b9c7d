#include <catch2/catch.hpp>
#include <map>

#include "sim/subjects/head_shape.h"
#include "world_scene.h"

using namespace lightstage;
using sim::Vec3f;

TEST_CASE("an isosurface is closed, faces outwards and lies on the surface") {
  const auto ball = [](Vec3f p) { return sim::norm(p - Vec3f(0.1F, -0.2F, 0.05F)) - 1; };
  for (const float cell : {0.5F, 0.13F}) {
    const sim::TriangleMesh mesh = sim::isosurface(ball, {{-1.7F, -1.9F, -1.7F}, {1.8F, 1.6F, 1.8F}}, cell);
    REQUIRE(mesh.triangles.size() > 20);
    std::map<std::pair<std::uint32_t, std::uint32_t>, int> edges;
    double volume = 0;
    for (const sim::Triangle& t : mesh.triangles) {
      for (std::size_t k = 0; k < 3; ++k) ++edges[{t[k], t[(k + 1) % 3]}];
      volume += double(sim::dot(mesh.positions[t[0]], sim::cross(mesh.positions[t[1]], mesh.positions[t[2]]))) / 6;
    }
    // Every edge once each way.
    for (const auto& [edge, count] : edges) {
      CHECK(count == 1);
      CHECK(edges.count({edge.second, edge.first}) == 1);
    }
    CHECK(volume == Approx(4.18879).epsilon(double(cell) * double(cell)));
    for (std::size_t i = 0; i < mesh.positions.size(); ++i) {
      CHECK(std::abs(ball(mesh.positions[i])) < 1e-3F);
      CHECK(sim::dot(mesh.normals[i], sim::normalised(mesh.positions[i] - Vec3f(0.1F, -0.2F, 0.05F))) > 1 - 0.02F * cell);
    }
  }
}

TEST_CASE("every head stays inside its box and is one of its kind") {
  for (std::uint64_t seed = 0; seed < 40; ++seed) {
    const sim::HeadShape shape(seed);
    const sim::Box box = shape.bounds();
    INFO("seed " << seed);
    for (int i = 0; i < 400; ++i) {
      // Points of the box's six faces.
      const float a = float(i % 20) / 19, b = float(i / 20) / 19;
      const Vec3f e = box.high - box.low;
      for (const Vec3f p : {Vec3f(a * e.x, b * e.y, 0), Vec3f(a * e.x, b * e.y, e.z), Vec3f(a * e.x, 0, b * e.z),
                            Vec3f(a * e.x, e.y, b * e.z), Vec3f(0, a * e.y, b * e.z), Vec3f(e.x, a * e.y, b * e.z)}) {
        CHECK(shape.distance(box.low + p) > 0);
      }
    }
    CHECK(shape.distance({0, 0, 0}) < 0);
    // The nose is before the eyes, the ears outside the temples.
    const auto front = [&](float x, float y) {
      float z = 13.5F;
      while (z > 0 && shape.distance({x, y, z}) > 0) z -= 0.05F;
      return z;
    };
    CHECK(front(0, -3.4F) > front(3.2F, 0) + 1.0F);
    CHECK(front(0, -3.4F) > front(0, -8.4F) + 0.7F);
    CHECK(shape.ear_distance({8.0F, -0.8F, -1.2F}) < 0.8F);
  }
}

TEST_CASE("a head's seed decides the picture, and nothing else does") {
  const auto picture = [](std::uint64_t seed) {
    sim::Simulation simulation = test::still_simulation(sim::SubjectKind::kProceduralHead, 1, 64);
    simulation.stage.light_positions = {{0.4, 0.6, 1.3}};
    simulation.subject.seed = seed;
    const sim::World world(simulation);
    return world.render(test::camera_of(world), test::all_lights(world), 0);
  };
  const core::Image first = picture(1);
  CHECK(picture(1) == first);
  CHECK(test::psnr(picture(2), first) < 30);
}

TEST_CASE("a head fills the height it is given, is textured and casts shadows") {
  sim::Simulation simulation = test::still_simulation(sim::SubjectKind::kProceduralHead, 0, 120);
  simulation.stage.light_positions = {{1.2, 0.5, 0.8}, {-1.2, 0.5, 0.8}};
  const sim::World world(simulation);
  const core::CameraModel& camera = test::camera_of(world);
  const core::Image covered = world.coverage(camera, 0);
  int top = 120, bottom = -1;
  for (int y = 0; y < 120; ++y) {
    for (int x = 0; x < 120; ++x) {
      if (covered(y, x) < 0.5F) continue;
      top = std::min(top, y);
      bottom = std::max(bottom, y);
    }
  }
  CHECK(bottom - top + 1 == Approx(camera.fy * 0.25 / test::kCameraDistance).margin(4));

  // Of the pixels that both lights would reach on a convex head, each leaves some in shadow.
  const capture::LightLevel left{1}, right{0};
  const core::Image a = world.render(camera, {&left, 1}, 0), b = world.render(camera, {&right, 1}, 0);
  int dark_a = 0, dark_b = 0, faces = 0;
  for (int y = 0; y < 120; ++y) {
    for (int x = 0; x < 120; ++x) {
      if (covered(y, x) < 0.99F) continue;
      ++faces;
      dark_a += a(y, x, 1) < 1e-3F ? 1 : 0;
      dark_b += b(y, x, 1) < 1e-3F ? 1 : 0;
    }
  }
  CHECK(dark_a > faces / 20);
  CHECK(dark_b > faces / 20);
  CHECK(dark_a < faces * 3 / 4);
  CHECK(dark_b < faces * 3 / 4);
}
