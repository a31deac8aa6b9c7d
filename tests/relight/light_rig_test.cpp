// Light rigs and what moves in them.
#include "relight/light_rig.h"

#include <catch2/catch.hpp>
#include <fstream>

#include "core/error.h"
#include "core/file.h"
#include "core/sphere.h"
#include "support/support.h"

namespace lightstage {

namespace {

using core::Direction;
using core::Vec3;
using relight::LightRig;

LightRig parse(const std::string& text) {
  return LightRig::parse(text, "rig.toml", "/rigs");
}

void refused(const std::string& text, const std::vector<std::string>& words) {
  CAPTURE(text);
  try {
    parse(text);
    FAIL("was taken");
  } catch (const core::BadInput& error) {
    for (const std::string& word : words) CHECK_THAT(error.what(), Catch::Contains(word));
  }
}

}  // namespace

TEST_CASE("the rig of docs/relight.md is read as it says") {
  const std::string page = core::read_text_file(std::filesystem::path(LIGHTSTAGE_DOCS) / "relight.md");
  const std::size_t begin = page.find("```toml\n") + 8;
  const LightRig rig = LightRig::parse(page.substr(begin, page.find("```", begin) - begin), "relight.md", "rigs");
  CHECK(rig.frames == 97);
  REQUIRE(rig.lights.size() == 2);
  REQUIRE(rig.environment);
  CHECK(rig.environment->file == "rigs/dusk.hdr");
  const relight::RigFrame first = rig.frame(0), middle = rig.frame(48), last = rig.frame(96);
  REQUIRE(first.fixed.size() == 1);
  REQUIRE(first.moving.size() == 1);
  CHECK(first.fixed == last.fixed);
  CHECK(first.fixed[0].radius_degrees == 8);
  CHECK(first.moving[0].direction == Direction::from_longitude_latitude_degrees(-60, 20));
  CHECK(last.moving[0].direction == Direction::from_longitude_latitude_degrees(60, 20));
  CHECK(middle.moving[0].direction == Direction::from_longitude_latitude_degrees(0, 40));
  CHECK(middle.moving[0].radius_degrees == Approx(6));
  CHECK(first.environment->rotate_degrees == 0);
  CHECK(middle.environment->rotate_degrees == 90);
  CHECK(last.environment->rotate_degrees == 180);
  CHECK(last.environment->exposure_stops == -2);
}

TEST_CASE("directions go along great circles, other values on straight lines, and hold before and after their keys") {
  const LightRig rig = parse(R"(
fps = 10
[[light]]
intensity = 2
key = [{time_s = 1, direction = [1, 0, 0], radius_deg = 0, colour = [1, 0, 0]},
       {time_s = 2, direction = [0, 1, 0]},
       {time_s = 3, radius_deg = 30, colour = [0, 1, 4]}]
)");
  CHECK(rig.frames == 31);
  const auto at = [&](int frame) { return rig.frame(frame).moving.at(0); };
  CHECK(at(0) == at(10));
  CHECK(at(0).direction == Direction::from_vector({1, 0, 0}));
  CHECK(at(20).direction == Direction::from_vector({0, 1, 0}));
  CHECK(at(30).direction == at(20).direction);
  for (const int frame : {11, 13, 15, 18}) {
    const double angle = (frame - 10) / 10.0 * std::acos(0.0);
    CHECK(core::angle_radians(at(frame).direction, Direction::from_vector({std::cos(angle), std::sin(angle), 0})) <
          1e-15);
  }
  CHECK(at(20).radius_degrees == 15);
  CHECK(at(20).irradiance == Vec3{1, 1, 4});
  CHECK(at(30).irradiance == Vec3{0, 2, 8});
  CHECK(rig.frame(1000).moving.at(0) == at(30));
}

TEST_CASE(
    "paths between near, nearly opposite and equal directions stay unit vectors on the way; opposite ones are "
    "refused") {
  const Direction axis = Direction::from_vector({0.3, -0.2, 0.7});
  for (const Direction& other : {axis, Direction::from_vector(axis.vec() + Vec3{1e-12, 0, 0}),
                                 Direction::from_vector({1e-5 - 0.3, 0.2, -0.7})}) {
    const double whole = core::angle_radians(axis, other);
    CHECK(relight::between(axis, other, 0) == axis);
    CHECK(relight::between(axis, other, 1) == other);
    for (const double share : {1e-300, 0.1, 0.5, 0.999}) {
      const Direction d = relight::between(axis, other, share);
      CHECK(core::norm(d.vec()) == Approx(1).epsilon(1e-14));
      CHECK(core::angle_radians(axis, d) == Approx(share * whole).margin(1e-9));
    }
  }
  CHECK_THROWS_AS(relight::between(axis, Direction::from_vector(-axis.vec()), 0.5), core::UsageError);
}

TEST_CASE("a path that ends where it began is bit-equal there") {
  const LightRig rig = parse(R"(
frames = 9
fps = 3
[[light]]
key = [{time_s = 0, direction = [10, 20]}, {time_s = 1, direction = [130, 20]}, {time_s = 2, direction = [250, 20]},
       {time_s = 3, direction = [10, 20]}]
[environment]
file = "maps/sky.exr"
key = [{time_s = 0, rotate_deg = 0}, {time_s = 3, rotate_deg = 360}]
)");
  CHECK(rig.frame(9).moving == rig.frame(0).moving);
  CHECK(rig.frame(3).moving[0].direction == Direction::from_longitude_latitude_degrees(130, 20));
  CHECK(rig.environment->file == "/rigs/maps/sky.exr");
  CHECK(rig.frame(9).environment->rotate_degrees == 360);
}

TEST_CASE("a rig needs no more than a light or an environment, and is then one picture") {
  const LightRig light = parse("[[light]]\ndirection = [0, 0, 2]\n");
  CHECK(light.frames == 1);
  CHECK(light.frame(0).fixed == std::vector{relight::AreaLight{Direction(), 0, {1, 1, 1}}});
  CHECK(light.frame(0).moving.empty());
  CHECK_FALSE(light.frame(0).environment);
  const LightRig sky = parse("frames = 3\n[environment]\nfile = 'sky.hdr'\nrotate_deg = -30\n");
  CHECK(sky.frames == 3);
  CHECK(*sky.frame(2).environment == relight::PlacedEnvironment{"/rigs/sky.hdr", -30, 0});
  CHECK(parse("fps = 24\n[[light]]\nkey = [{time_s = 0.5, direction=[0,0,1]}]\n").frames == 13);
}

TEST_CASE("what is wrong with a rig is said with file, line and key") {
  refused("", {"rig.toml:1", "'light'", "[environment]"});
  refused("[[light]]\n", {"rig.toml:1", "light[0].direction", "missing"});
  refused("[[light]]\ndirection = [0, 0, 0]\n", {"rig.toml:2", "light[0].direction", "no length"});
  refused("[[light]]\ndirection = [10, 95]\n", {"rig.toml:2", "light[0].direction", "latitude"});
  refused("[[light]]\ndirection = [1]\n", {"rig.toml:2", "direction", "[longitude, latitude]"});
  refused("[[light]]\ndirection = [0, 1]\nradius_deg = 181\n", {"rig.toml:3", "radius_deg", "180", "181"});
  refused("[[light]]\ndirection = [0, 1]\ncolour = [1, -1, 0]\n", {"rig.toml:3", "colour", "-1"});
  refused("[[light]]\ndirection = [0, 1]\ncolour = [1, 1]\n", {"rig.toml:3", "colour", "3 numbers"});
  refused("[[light]]\ndirection = [0, 1]\nintensity = nan\n", {"rig.toml:3", "intensity", "finite"});
  refused("[[light]]\ndirection = [0, 1]\nradius = 3\n", {"rig.toml:3", "light[0].radius", "not known"});
  refused("[environment]\nrotate_deg = 3\n", {"rig.toml:1", "environment.file", "missing"});
  refused("[environment]\nfile = ''\n", {"rig.toml:2", "environment.file"});
  refused("[environment]\nfile = 'a.hdr'\nexposure_ev = 1000\n", {"rig.toml:3", "exposure_ev", "60"});
  refused("frames = 0\n[[light]]\ndirection = [0, 1]\n", {"rig.toml:1", "frames"});
  refused("fps = 0\n[[light]]\ndirection = [0, 1]\n", {"rig.toml:1", "fps"});
  refused("fps = 1000\n[[light]]\nkey = [{time_s = 1e5, direction = [0, 1]}]\n", {"rig.toml:1", "fps", "1000000"});

  refused("[[light]]\n[[light.key]]\ndirection = [0, 1]\n", {"rig.toml:2", "light[0].key[0].time_s", "missing"});
  refused("[[light]]\n[[light.key]]\ntime_s = 1\ndirection = [0, 1]\n[[light.key]]\ntime_s = 1\n",
          {"rig.toml:6", "light[0].key[1].time_s", "later"});
  refused("[[light]]\ndirection = [0, 1]\n[[light.key]]\ntime_s = 1\ndirection = [0, 1]\n",
          {"rig.toml:5", "light[0].key[0].direction", "already"});
  refused(
      "[[light]]\n[[light.key]]\ntime_s = 0\ndirection = [0, 0, 1]\n[[light.key]]\ntime_s = 1\ndirection = [180, 0]\n",
      {"rig.toml:7", "light[0].key[1].direction", "opposite", "between"});
}

TEST_CASE("a rig's environment lies beside it") {
  const test::TemporaryFolder folder;
  std::ofstream(folder / "rig.toml") << "[environment]\nfile = 'maps/sky.hdr'\n";
  CHECK(LightRig::read(folder / "rig.toml").environment->file == folder / "maps/sky.hdr");
  CHECK_THROWS_WITH(LightRig::read(folder / "absent.toml"), Catch::Contains("absent.toml"));
}

}  // namespace lightstage
