#include "core/direction.h"

#include <catch2/catch.hpp>
#include <cmath>
#include <limits>
#include <numbers>

#include "core/error.h"
#include "core/failure.h"

using namespace lightstage;
using core::Direction;

namespace {

constexpr double kUlp = std::numeric_limits<double>::epsilon();

}  // namespace

TEST_CASE("a direction has unit length whatever the length of its vector") {
  const core::Vec3 v{1, -2, 2};
  for (const double scale : {1.0, 1e-300, 1e307, 1e-3}) {
    const Direction d = Direction::from_vector(scale * v);
    CHECK(d.x() == Approx(1.0 / 3).margin(2 * kUlp));
    CHECK(d.y() == Approx(-2.0 / 3).margin(2 * kUlp));
    CHECK(std::abs(core::norm(d.vec()) - 1) <= 2 * kUlp);
  }
}

TEST_CASE("denormal vectors lose no direction") {
  const double tiny = std::numeric_limits<double>::denorm_min();
  CHECK(Direction::from_vector({3 * tiny, 4 * tiny, 0}) == Direction::from_vector({3, 4, 0}));
  CHECK(Direction::from_vector({0, -tiny, 0}).y() == -1);
}

TEST_CASE("vectors without a direction are refused") {
  constexpr double inf = std::numeric_limits<double>::infinity();
  CHECK_THROWS_AS(Direction::from_vector({0, 0, 0}), core::BadInput);
  CHECK_THROWS_AS(Direction::from_vector({0, -0.0, 0}), core::BadInput);
  CHECK_THROWS_AS(Direction::from_vector({1, inf, 0}), core::BadInput);
  CHECK_THROWS_AS(Direction::from_vector({1, 0, std::nan("")}), core::BadInput);
  CHECK_THROWS_AS(Direction::from_longitude_latitude_degrees(0, 90.1), core::BadInput);
  CHECK_THROWS_AS(Direction::from_longitude_latitude_degrees(inf, 0), core::BadInput);
  CHECK_THROWS_AS(Direction::from_longitude_latitude_degrees(0, std::nan("")), core::BadInput);
}

TEST_CASE("longitude and latitude follow the environment map: 0 is +z, +90 is +x, up is +y") {
  const auto at = [](double longitude, double latitude) {
    return Direction::from_longitude_latitude_degrees(longitude, latitude).vec();
  };
  CHECK(at(0, 0) == core::Vec3{0, 0, 1});
  CHECK(at(90, 0) == core::Vec3{1, 0, 0});
  CHECK(at(-90, 0) == core::Vec3{-1, 0, 0});
  CHECK(at(180, 0) == core::Vec3{0, 0, -1});
  CHECK(at(450, 0) == core::Vec3{1, 0, 0});
  CHECK(at(37, 90) == core::Vec3{0, 1, 0});
  CHECK(at(37, -90) == core::Vec3{0, -1, 0});
}

TEST_CASE("angles of the sphere survive the way there and back") {
  for (double latitude = -89.5; latitude < 90; latitude += 7.1)
    for (double longitude = -179.9; longitude <= 180; longitude += 13.7) {
      const Direction d = Direction::from_longitude_latitude_degrees(longitude, latitude);
      CHECK(d.longitude_degrees() == Approx(longitude).margin(1e-10));
      CHECK(d.latitude_degrees() == Approx(latitude).margin(1e-10));
    }
  CHECK(Direction::from_vector({0, 1, 0}).longitude_degrees() == 0);
  CHECK(Direction::from_vector({-0.0, -1, -0.0}).longitude_degrees() == 0);
  CHECK(Direction::from_vector({0, 1, 0}).latitude_degrees() == 90);
  // The back is +180, never -180.
  CHECK(Direction::from_vector({-0.0, 0, -1}).longitude_degrees() == 180);
  CHECK(Direction::from_vector({0, 0, -1}).longitude_degrees() == 180);
  // Near the pole asin would have lost half the digits.
  CHECK(90 - Direction::from_vector({1e-9, 1, 0}).latitude_degrees() ==
        Approx(core::degrees_from_radians(1e-9)).epsilon(1e-6));
}

TEST_CASE("the angle between directions is exact where acos is not") {
  const Direction z;
  for (const double angle : {1e-15, 1e-12, 1e-9, 1e-6, 1e-3, 1.0, 3.0}) {
    const Direction other = Direction::from_vector({std::sin(angle), 0, std::cos(angle)});
    CHECK(angle_radians(z, other) == Approx(angle).epsilon(4 * kUlp));
    const Direction opposite = Direction::from_vector(-other.vec());
    CHECK(angle_radians(z, opposite) == Approx(std::numbers::pi - angle).margin(4 * kUlp));
  }
  CHECK(angle_radians(z, z) == 0);
  CHECK(angle_radians(z, Direction::from_vector({0, 0, -5})) == Approx(std::numbers::pi).epsilon(kUlp));
}

TEST_CASE("directions are parsed from vectors and from angles") {
  CHECK(core::parse_direction("0, 0,-2.5e3").vec() == core::Vec3{0, 0, -1});
  CHECK(core::parse_direction("90,0").vec() == core::Vec3{1, 0, 0});
  CHECK(core::parse_direction(" +0 , +90 ").vec() == core::Vec3{0, 1, 0});
  for (const char* text : {"", "1", "1,2,3,4", "1,,2", "a,b,c", "0,0,0", "0,91", "1,2,nan", "1,2,3x", "inf,0,0"}) {
    INFO(text);
    const std::string message = test::failure_of<core::BadInput>([&] { core::parse_direction(text); });
    CHECK(test::says(message, text, "is not a direction", "x,y,z or longitude,latitude"));
  }
}

TEST_CASE("a rotation turns by the right hand and keeps lengths") {
  const core::Vec3 v = core::rotation_about({0, 0, 7}, std::numbers::pi / 2) * core::Vec3{1, 0, 5};
  CHECK(v.x == Approx(0).margin(1e-15));
  CHECK(v.y == Approx(1));
  CHECK(v.z == Approx(5));
  const core::Mat3 r = core::rotation_about({1, 2, 3}, 0.7);
  const core::Mat3 unit = r * r.transposed();
  for (std::size_t i = 0; i < 3; ++i) {
    CHECK(core::norm(unit.rows[i]) == Approx(1).epsilon(1e-14));
    CHECK(std::abs(core::dot(r.rows[i], r.rows[(i + 1) % 3])) < 1e-15);
  }
  // A turn as small as float64 can tell is not lost.
  const core::Vec3 nudged = core::rotation_about({0, 1, 0}, 1e-12) * core::Vec3{0, 0, 1};
  CHECK(nudged.x == Approx(1e-12).epsilon(1e-12));
  CHECK_THROWS_AS(core::rotation_about({0, 0, 0}, 1), core::BadInput);
}

TEST_CASE("a rigid transform and its inverse cancel") {
  const core::RigidTransform t{core::rotation_about({1, -1, 2}, 2.1), {3, -4, 5}};
  const core::Vec3 p{0.1, 20, -7};
  CHECK(core::norm(t.inverse().apply(t.apply(p)) - p) < 1e-13);
}
