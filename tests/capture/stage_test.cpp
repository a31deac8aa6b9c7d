#include "capture/stage.h"

#include <bit>
#include <catch2/catch.hpp>
#include <fstream>
#include <set>

#include "core/direction.h"
#include "core/error.h"
#include "core/sphere.h"
#include "support/support.h"

using namespace lightstage;
using capture::Layout;
using capture::LayoutOptions;
using capture::Stage;

namespace {

std::vector<core::Direction> directions(const Stage& stage) {
  std::vector<core::Direction> result;
  for (const core::Light& light : capture::nominal_lights(stage)) result.push_back(light.direction);
  return result;
}

bool same_bits(double a, double b) {
  return std::bit_cast<std::uint64_t>(a) == std::bit_cast<std::uint64_t>(b);
}
bool same_bits(core::Vec3 a, core::Vec3 b) {
  return same_bits(a.x, b.x) && same_bits(a.y, b.y) && same_bits(a.z, b.z);
}

std::string message_of(const std::string& toml) {
  try {
    capture::parse_stage(toml, "stage.toml");
  } catch (const core::BadInput& error) {
    return error.what();
  }
  return "(no error)";
}

// A stage file with one line replaced (every occurrence of `from`).
std::string changed(const std::string& from, const std::string& to) {
  LayoutOptions options;
  options.lights = 3;
  options.cameras = 2;
  std::string text = capture::to_toml(capture::make_stage("s", options));
  const std::size_t at = text.find(from);
  REQUIRE(at != std::string::npos);
  return text.replace(at, from.size(), to);
}

int line_of(const std::string& text, const std::string& part) {
  const std::size_t at = text.find(part);
  REQUIRE(at != std::string::npos);
  return 1 + static_cast<int>(std::count(text.begin(), text.begin() + static_cast<std::ptrdiff_t>(at), '\n'));
}

}  // namespace

TEST_CASE("a layout has exactly the lights asked for, outside its holes, top down") {
  const auto layout = GENERATE(Layout::kGeodesic, Layout::kFibonacci);
  const std::size_t n = GENERATE(1u, 2u, 12u, 150u, 180u, 302u, 1001u);
  LayoutOptions options;
  options.layout = layout;
  options.lights = n;
  options.cameras = 3;
  const Stage stage = capture::make_stage("demo", options);
  CAPTURE(n, static_cast<int>(layout));
  REQUIRE(stage.light_positions.size() == n);

  const std::vector<core::Direction> lights = directions(stage);
  const core::Direction down = core::Direction::from_vector({0, -1, 0});
  for (std::size_t i = 0; i < n; ++i) {
    REQUIRE(norm(stage.light_positions[i]) == Approx(1.5).epsilon(1e-12));
    REQUIRE(core::degrees_from_radians(core::angle_radians(lights[i], down)) >= 35 - 1e-9);
    for (const capture::StageCamera& camera : stage.cameras) {
      const auto at_camera = core::Direction::from_vector(camera.model.centre());
      REQUIRE(core::degrees_from_radians(core::angle_radians(lights[i], at_camera)) >= 6 - 1e-9);
    }
    if (i > 0) REQUIRE(lights[i].y() <= lights[i - 1].y() + 1e-8);
    for (std::size_t j = 0; j < i; ++j) REQUIRE(core::angle_radians(lights[i], lights[j]) > 1e-3);
  }
}

TEST_CASE("a Fibonacci layout covers what its holes leave evenly") {
  LayoutOptions options;
  options.layout = Layout::kFibonacci;
  options.lights = 180;
  const std::vector<core::Direction> lights = directions(capture::make_stage("demo", options));
  // Nothing outside the holes is further from its nearest light than twice the spacing.
  const double spacing = core::median_spacing_radians(lights);
  for (const core::Direction& d : core::fibonacci_directions(2000)) {
    const bool in_hole =
        d.y() < -std::cos(core::radians_from_degrees(36)) || d.z() > std::cos(core::radians_from_degrees(7));
    if (in_hole) continue;
    REQUIRE(core::angle_radians(d, lights[core::nearest_indices(lights, d, 1)[0]]) < 2 * spacing);
  }
}

TEST_CASE("cameras look at the centre and a head fills three quarters of the height") {
  LayoutOptions options;
  options.cameras = 5;
  options.radius_m = GENERATE(0.5, 1.5, 4.0);
  const Stage stage = capture::make_stage("demo", options);
  const std::array<double, 5> azimuths{0, 30, -30, 60, -60};
  for (std::size_t i = 0; i < 5; ++i) {
    const core::CameraModel& camera = stage.cameras[i].model;
    CAPTURE(i);
    const core::Direction towards = core::Direction::from_vector(camera.centre());
    CHECK(towards.longitude_degrees() == Approx(azimuths[i]).margin(1e-9));
    CHECK(towards.latitude_degrees() == Approx(0).margin(1e-9));
    CHECK(norm(camera.centre()) > options.radius_m);
    const auto centre = camera.project({0, 0, 0});
    REQUIRE(centre);
    CHECK(centre->x == Approx(255.5));
    CHECK(centre->y == Approx(255.5));
    const auto crown = camera.project({0, 0.125, 0}), chin = camera.project({0, -0.125, 0});
    REQUIRE((crown && chin));
    CHECK((chin->y - crown->y) / 512 == Approx(0.75).epsilon(0.01));
  }
}

TEST_CASE("one unit light reaches nine tenths of the scale in 20 ms") {
  const Stage stage = capture::make_stage("demo", {});
  CHECK(stage.cameras[0].responsivity * 0.020 == Approx(0.9));
}

TEST_CASE("layouts out of range are refused") {
  const auto message = [](auto change) {
    LayoutOptions options;
    change(options);
    try {
      capture::make_stage("demo", options);
    } catch (const core::UsageError& error) {
      return std::string(error.what());
    }
    return std::string("(no error)");
  };
  CHECK(message([](LayoutOptions& o) { o.lights = 0; }) == "stage layout: 1 to 10000 lights");
  CHECK(message([](LayoutOptions& o) { o.lights = 10001; }) == "stage layout: 1 to 10000 lights");
  CHECK(message([](LayoutOptions& o) { o.radius_m = NAN; }) == "stage layout: the radius must be 0.1 to 100 m");
  CHECK(message([](LayoutOptions& o) { o.cameras = 0; }) == "stage layout: 1 to 12 cameras can be placed");
  CHECK(message([](LayoutOptions& o) { o.cameras = 13; }) == "stage layout: 1 to 12 cameras can be placed");
  CHECK(message([](LayoutOptions& o) { o.camera_pixels = 7; }) ==
        "stage layout: a camera needs 8 to 16384 pixels a side");
  CHECK(message([](LayoutOptions& o) { o.bottom_hole_degrees = 151; }) ==
        "stage layout: the bottom hole's half-angle must be 0 to 150 degrees");
  CHECK(message([](LayoutOptions& o) { o.camera_hole_degrees = -1; }) ==
        "stage layout: a camera hole's half-angle must be 0 to 45 degrees");
  CHECK_THROWS_AS(capture::make_stage("no/slash", {}), core::UsageError);
  CHECK_THROWS_AS(capture::make_stage("", {}), core::UsageError);
}

TEST_CASE("the tightest holes still end in a stage or a clear refusal") {
  LayoutOptions options;
  options.layout = GENERATE(Layout::kGeodesic, Layout::kFibonacci);
  options.lights = 40;
  options.bottom_hole_degrees = 150;
  options.camera_hole_degrees = 45;
  options.cameras = 12;
  const Stage stage = capture::make_stage("tight", options);
  CHECK(stage.light_positions.size() == 40);
}

TEST_CASE("lights of an .lp file keep their order and directions") {
  const test::TemporaryFolder folder;
  std::ofstream(folder / "my dome.lp") << "3\na.png 0 0 1\nb.png 1 0 0\nc.png 0 2 0\n";
  LayoutOptions options;
  options.radius_m = 2;
  const Stage stage = capture::stage_from_lp(folder / "my dome.lp", options);
  CHECK(stage.name == "my-dome");
  CHECK(stage.light_positions == std::vector<core::Vec3>{{0, 0, 2}, {2, 0, 0}, {0, 2, 0}});
  CHECK(stage.cameras.size() == 1);
  CHECK_THROWS_AS(capture::stage_from_lp(folder / "missing.lp", options), core::BadInput);
}

TEST_CASE("a stage file reads back bit for bit") {
  LayoutOptions options;
  options.lights = 61;
  options.cameras = 3;
  Stage stage = capture::make_stage("demo-1.2_x", options);
  stage.light_positions[7] = {-0.0, 1e-310, 1.0 / 3};
  stage.light_positions[8] = {1e300, -123456789.125, 2};
  stage.cameras[1].model.k2 = 0.1 + 0.2;
  stage.cameras[1].model.p1 = -0.0;
  stage.cameras[2].responsivity = std::nextafter(45.0, 46.0);
  stage.limits = {2.9, 59.94, 0.1 / 3, 0.3, 1.0 / 7, 19.5, 0.7};
  stage.simulation = {0xfedcba9876543210u, 0.3, 0.1 / 3, 0.02, {0, 60, 5}};

  const std::string text = capture::to_toml(stage);
  const Stage back = capture::parse_stage(text, "stage.toml");
  CHECK(capture::to_toml(back) == text);
  CHECK(back.name == stage.name);
  CHECK(same_bits(back.radius_m, stage.radius_m));
  REQUIRE(back.light_positions.size() == stage.light_positions.size());
  for (std::size_t i = 0; i < stage.light_positions.size(); ++i) {
    CHECK(same_bits(back.light_positions[i], stage.light_positions[i]));
  }
  REQUIRE(back.cameras.size() == 3);
  for (std::size_t i = 0; i < 3; ++i) {
    const core::CameraModel &a = stage.cameras[i].model, &b = back.cameras[i].model;
    CHECK(back.cameras[i].name == stage.cameras[i].name);
    CHECK(same_bits(back.cameras[i].responsivity, stage.cameras[i].responsivity));
    CHECK((a.width == b.width && a.height == b.height));
    for (const auto member : {&core::CameraModel::fx, &core::CameraModel::fy, &core::CameraModel::cx,
                              &core::CameraModel::cy, &core::CameraModel::k1, &core::CameraModel::k2,
                              &core::CameraModel::k3, &core::CameraModel::p1, &core::CameraModel::p2}) {
      CHECK(same_bits(a.*member, b.*member));
    }
    for (std::size_t r = 0; r < 3; ++r) {
      CHECK(same_bits(a.stage_from_camera.rotation.rows[r], b.stage_from_camera.rotation.rows[r]));
    }
    CHECK(same_bits(a.centre(), b.centre()));
  }
  CHECK(back.simulation.seed == stage.simulation.seed);
  CHECK(same_bits(back.simulation.mount_error_degrees, 0.3));
  CHECK(same_bits(back.simulation.gain_spread, 0.1 / 3));
  CHECK(same_bits(back.simulation.led_radius_m, 0.02));
  CHECK(back.simulation.dead_lights == std::vector<int>{0, 60, 5});
  CHECK(back.limits == stage.limits);
  CHECK(capture::stage_key(back) == capture::stage_key(stage));

  const test::TemporaryFolder folder;
  std::ofstream(folder / "stage.toml") << text;
  CHECK(capture::to_toml(capture::read_stage(folder / "stage.toml")) == text);
}

TEST_CASE("names that would not read back are not written") {
  Stage stage = capture::make_stage("s", {});
  stage.name = "tower \"7\"";
  CHECK_THROWS_AS(capture::to_toml(stage), core::BadInput);
  stage.name = "tower-7";
  stage.cameras[0].name = "a\nb";
  CHECK_THROWS_AS(capture::to_toml(stage), core::BadInput);
}

TEST_CASE("a stage file needs no simulation table") {
  const Stage stage = capture::parse_stage(changed("[simulation]\nseed = 1\nmount_error_degrees = 0.0\n"
                                                   "gain_spread = 0.0\nled_radius_m = 0.012\ndead_lights = []\n",
                                                   ""),
                                           "stage.toml");
  CHECK(stage.simulation.led_radius_m == 0.012);
  CHECK(stage.simulation.dead_lights.empty());
}

TEST_CASE("a stage file without limits has those that protect people") {
  std::string text = changed("[[light]]", "[[light]]");
  const std::size_t begin = text.find("[limits]");
  text.erase(begin, text.find("[[camera]]") - begin);
  const Stage stage = capture::parse_stage(text, "stage.toml");
  CHECK(stage.limits == capture::LightLimits{});
  CHECK(stage.limits.strobe_share < 1);
}

TEST_CASE("the stage key names lights, not cameras") {
  const Stage stage = capture::make_stage("demo", {});
  const std::string key = capture::stage_key(stage);
  CHECK(key.size() == 5 + 16);
  CHECK(key.starts_with("demo-"));

  Stage other = stage;
  other.cameras[0].model.fx *= 2;
  other.cameras.push_back(other.cameras[0]);
  CHECK(capture::stage_key(other) == key);

  std::set<std::string> keys{key};
  const auto differs = [&](auto change) {
    Stage changed_stage = stage;
    change(changed_stage);
    return keys.insert(capture::stage_key(changed_stage)).second;
  };
  CHECK(differs([](Stage& s) { s.name = "demo2"; }));
  CHECK(differs([](Stage& s) { s.radius_m = std::nextafter(s.radius_m, 9.0); }));
  CHECK(differs([](Stage& s) { s.light_positions[3].y += 1e-12; }));
  CHECK(differs([](Stage& s) { std::swap(s.light_positions[0], s.light_positions[1]); }));
  CHECK(differs([](Stage& s) { s.light_positions.pop_back(); }));
  CHECK(differs([](Stage& s) { s.simulation.seed = 2; }));
  CHECK(differs([](Stage& s) { s.simulation.mount_error_degrees = 0.5; }));
  CHECK(differs([](Stage& s) { s.simulation.gain_spread = 0.5; }));
  CHECK(differs([](Stage& s) { s.simulation.led_radius_m = 0.5; }));
  CHECK(differs([](Stage& s) { s.simulation.dead_lights = {4}; }));
}

TEST_CASE("malformed stage files are refused with file, line and key") {
  const std::string good = changed("[[light]]", "[[light]]");
  const auto expect = [&](const std::string& from, const std::string& to, const std::string& key,
                          const std::string& problem) {
    const std::string at = "stage.toml:" + std::to_string(line_of(good, from)) + ": ";
    CHECK(message_of(changed(from, to)) == at + "key '" + key + "' " + problem);
  };
  CHECK(message_of(good) == "(no error)");
  expect("radius_m = 1.5", "radius_m = -1.5", "radius_m", "must be above 0");
  expect("radius_m = 1.5", "radius_m = nan", "radius_m", "must be finite");
  expect("radius_m = 1.5", "radius_m = \"big\"", "radius_m", "must be a number");
  expect("name = \"s\"", "name = \"a b\"", "name", "must be made of letters, digits, '-', '_' and '.'");
  expect("name = \"cam1\"", "name = \"cam0\"", "camera[1].name", "is another camera's already");
  expect("width_pixels = 512", "width_pixels = 0", "camera[0].width_pixels", "must be 1 to 65536");
  expect("right = [1.0", "right = [1.1", "camera[0].right", "is not a unit vector");
  expect("responsivity_per_s = ", "responsivity_per_s = -", "camera[0].responsivity_per_s", "must be above 0");
  expect("dead_lights = []", "dead_lights = [3]", "simulation.dead_lights",
         "must hold indices of the stage's 3 lights, from 0");
  expect("dead_lights = []", "dead_lights = [0.5]", "simulation.dead_lights",
         "must hold indices of the stage's 3 lights, from 0");
  expect("mount_error_degrees = 0.0", "mount_error_degrees = -1", "simulation.mount_error_degrees",
         "must not be negative");
  expect("strobe_band_hz = [3", "strobe_band_hz = [0", "limits.strobe_band_hz",
         "must be two rising numbers from 1 to 1000");
  expect("strobe_band_hz = [3.0, 60", "strobe_band_hz = [3.0, 2", "limits.strobe_band_hz",
         "must be two rising numbers from 1 to 1000");
  expect("strobe_share = 0.1", "strobe_share = 0", "limits.strobe_share", "must be 0.001 to 1.0");
  expect("strobe_area = 0.25", "strobe_area = 1.5", "limits.strobe_area", "must be 0.001 to 1.0");
  expect("duty = 1.0", "duty = nan", "limits.duty", "must be finite");
  expect("on_time_s = 0.0", "on_time_s = -1", "limits.on_time_s", "must be 0.0 to 86400.0");
  expect("duty_window_s", "duty_windw_s", "limits.duty_windw_s", "is not known (did you mean 'duty_window_s'?)");
  expect("gain_spread", "gain_spraed", "simulation.gain_spraed", "is not known (did you mean 'gain_spread'?)");

  CHECK(message_of("name = \"s\"\nradius_m = 1\n").find("'camera'") != std::string::npos);
  CHECK(message_of("name = \"s\nradius_m = 1\n").starts_with("stage.toml:1: "));
  CHECK(message_of(changed("position_m = [", "position_m = [7, ")).find("must have 3 numbers, not 4") !=
        std::string::npos);
}

TEST_CASE("lights at the centre and stages without lights are refused") {
  const std::string good = changed("[[light]]", "[[light]]");
  const std::string head = good.substr(0, good.find("[[light]]"));
  const int line = 1 + static_cast<int>(std::count(head.begin(), head.end(), '\n'));
  CHECK(message_of(head + "[[light]]\nposition_m = [0, 0.0, 0]\n") ==
        "stage.toml:" + std::to_string(line + 1) +
            ": key 'light[0].position_m' is the stage centre: a light there has no direction");
  CHECK(message_of(head).find("key 'light' is missing: a stage needs at least one [[light]]") != std::string::npos);
}
