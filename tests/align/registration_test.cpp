#include "align/registration.h"

#include <catch2/catch.hpp>
#include <limits>
#include <random>

#include "align/moving_pictures.h"
#include "core/error.h"
#include "core/parallel.h"
#include "core/sphere.h"

namespace lightstage::align {

namespace {

// A textured bump under lights from in front, each picture moved a little.
struct Drifting {
  static constexpr int kSize = 120;
  std::vector<core::Direction> lights;
  std::vector<RigidMotion> motions;
  std::vector<core::Image> pictures;

  explicit Drifting(double px) {
    const test::Texture albedo(4);
    std::mt19937_64 random(3);
    std::uniform_real_distribution<double> uniform(-1, 1);
    for (const core::Direction& light : core::fibonacci_directions(120)) {
      if (light.z() < 0.5) continue;
      const RigidMotion motion{px * uniform(random), px * uniform(random), 0.005 * px * uniform(random)};
      lights.push_back(light);
      motions.push_back(motion);
      core::Image picture(kSize, kSize, 1);
      for (int y = 0; y < kSize; ++y) {
        for (int x = 0; x < kSize; ++x) {
          // The surface point seen here: motions are small, so their inverse is their negative.
          const double cx = x - 0.5 * (kSize - 1) - motion.dx, cy = y - 0.5 * (kSize - 1) - motion.dy;
          const double px_x = cx + motion.radians * cy, px_y = cy - motion.radians * cx;
          const double nx = 0.8 * px_x / kSize, ny = -0.8 * px_y / kSize, nz = std::sqrt(1 - nx * nx - ny * ny);
          const double shading = std::max(0.0, nx * light.x() + ny * light.y() + nz * light.z());
          picture(y, x) = float(shading * albedo(px_x, px_y));
        }
      }
      pictures.push_back(test::noisy(picture, 0.4, lights.size()));
    }
  }
  std::vector<Registered> run() const {
    return register_pictures([&](std::size_t i) { return pictures[i]; }, lights);
  }
};

}  // namespace

TEST_CASE("drift between pictures under different lights is found to a tenth of a pixel") {
  const Drifting set(1.5);
  REQUIRE(set.lights.size() > 20);
  const std::vector<Registered> found = set.run();
  RigidMotion mean;
  for (const RigidMotion& motion : set.motions) {
    mean.dx += motion.dx / double(set.motions.size());
    mean.dy += motion.dy / double(set.motions.size());
  }
  std::vector<double> errors;
  double before = 0, after = 0;
  for (std::size_t i = 0; i < found.size(); ++i) {
    CHECK(found[i].objection.empty());
    CHECK(found[i].correlation_after > found[i].correlation_before - 0.02);
    errors.push_back(
        std::hypot(found[i].motion.dx - set.motions[i].dx + mean.dx, found[i].motion.dy - set.motions[i].dy + mean.dy));
    before += found[i].residual_before_px;
    after += found[i].residual_after_px;
  }
  std::sort(errors.begin(), errors.end());
  INFO("median " << errors[errors.size() / 2] << ", largest " << errors.back());
  CHECK(errors[errors.size() / 2] < 0.1);
  CHECK(errors.back() < 0.4);
  CHECK(after < 0.5 * before);
}

TEST_CASE("pictures that did not move stay, and registering does not depend on the number of threads") {
  const Drifting set(0);
  const std::vector<Registered> found = set.run();
  for (const Registered& picture : found) CHECK(std::hypot(picture.motion.dx, picture.motion.dy) == 0);
  core::set_thread_count(3);
  const std::vector<Registered> again = set.run();
  core::set_thread_count(0);
  for (std::size_t i = 0; i < found.size(); ++i) {
    CHECK(found[i].motion.dx == again[i].motion.dx);
    CHECK(found[i].motion.radians == again[i].motion.radians);
    CHECK(found[i].residual_after_px == again[i].residual_after_px);
  }
}

TEST_CASE("a picture that is black, and one of something else, are named and stay where they are") {
  Drifting set(1);
  set.pictures[3] = core::Image(Drifting::kSize, Drifting::kSize, 1);
  set.pictures[9] = test::picture_of(test::Texture(77), Drifting::kSize, Drifting::kSize);
  const std::vector<Registered> found = set.run();
  CHECK_FALSE(found[3].objection.empty());
  CHECK_FALSE(found[9].objection.empty());
  int objections = 0;
  for (const Registered& picture : found) objections += !picture.objection.empty();
  CHECK(objections == 2);
}

TEST_CASE("a rigid motion's flow turns about the centre") {
  const RigidMotion motion{1, -2, 0.01};
  const FlowField flow = motion.flow(101, 201);
  CHECK(flow(50, 100, 0) == Approx(1));
  CHECK(flow(50, 100, 1) == Approx(-2));
  CHECK(flow(50, 200, 1) == Approx(-2 + 100 * std::sin(0.01)));
  CHECK(RigidMotion{}.flow(7, 9) == FlowField(7, 9, 2));
}

TEST_CASE("sets too small to register stay, and what cannot be registered is refused") {
  CHECK(register_pictures([](std::size_t) { return core::Image(); }, {}).empty());
  const std::vector<core::Direction> two(2), three(3);
  const core::Image picture = test::picture_of(test::Texture(2), 64, 64);
  for (const Registered& one : register_pictures([&](std::size_t) { return picture; }, two)) CHECK(one.motion.dx == 0);
  CHECK_THROWS_AS(register_pictures([](std::size_t) { return core::Image(20, 64, 1); }, three), core::BadInput);
  CHECK_THROWS_AS(register_pictures([](std::size_t i) { return core::Image(64, 64 + int(i), 1); }, three),
                  core::BadInput);
  core::Image bad = picture;
  bad(1, 1) = std::numeric_limits<float>::quiet_NaN();
  CHECK_THROWS_AS(register_pictures([&](std::size_t) { return bad; }, three), core::BadInput);
  // Nothing to hold on to.
  const std::vector<Registered> flat = register_pictures([](std::size_t) { return core::Image(64, 64, 3); }, three);
  for (const Registered& one : flat) CHECK_FALSE(one.objection.empty());
}

}  // namespace lightstage::align
