// Lights from loose pictures of balls.
#include <catch2/catch.hpp>
#include <cmath>
#include <fstream>

#include "calib/light_bundle.h"
#include "cli/program.h"
#include "core/direction.h"
#include "core/image_file.h"
#include "core/light_list.h"
#include "support/support.h"

using namespace lightstage;
namespace fs = std::filesystem;

namespace {

constexpr double kX = 61.25, kY = 55.5, kRadius = 40;

// A polished ball seen by parallel rays under a light far away in that direction: a small round spot where the normal halves the angle.
core::Image ball_under(core::Vec3 light, double strength, bool grey_ball) {
  core::Image image(112, 124, 1);
  const core::Vec3 sum = light + core::Vec3{0, 0, 1};
  const core::Vec3 normal = sum / norm(sum);
  for (int y = 0; y < image.height(); ++y) {
    for (int x = 0; x < image.width(); ++x) {
      const double from_centre = std::hypot(x - kX, y - kY), dx = x - kX - kRadius * normal.x,
                   dy = y - kY + kRadius * normal.y;
      const double ball = grey_ball ? std::clamp(kRadius + 0.5 - from_centre, 0.0, 1.0) * 0.2 : 0;
      image(y, x) = float(ball + strength * std::exp(-0.5 * (dx * dx + dy * dy) / 1.44));
    }
  }
  return image;
}

struct Lights {
  test::TemporaryFolder folder;
  std::vector<core::Vec3> truth;

  // Numbered without leading zeros: 10 comes after 9.
  Lights() {
    for (int i = 0; i < 11; ++i) {
      truth.push_back(core::Direction::from_longitude_latitude_degrees(-75 + 15 * i, 8 * (i % 5) - 16).vec());
      write(i, ball_under(truth.back(), 0.8, true));
    }
    std::ofstream(folder / "balls.toml") << "pictures = \"light*.png\"\nencoding = \"linear\"\n[[ball]]\n"
                                         << "circle = [61.25, 55.5, 40]\n";
  }
  void write(int i, const core::Image& image) const {
    core::write_image(folder / ("light" + std::to_string(i + 1) + ".png"), image,
                      {.pixel_type = core::PixelType::kUint16, .encoding = core::Encoding::kLinear});
  }
  test::Outcome run(const std::vector<std::string>& more) const {
    std::vector<std::string> arguments{"calibrate", "lights", "--balls", folder.path().string(), "--json"};
    arguments.insert(arguments.end(), more.begin(), more.end());
    return test::run_program(folder / "no store", arguments);
  }
  double error_degrees(const nlohmann::json& light) const {
    const auto& d = light.at("direction");
    return core::degrees_from_radians(
        core::angle_radians(core::Direction::from_vector({d[0], d[1], d[2]}),
                            core::Direction::from_vector(truth.at(light.at("index").get<std::size_t>()))));
  }
};

}  // namespace

TEST_CASE("lights are placed from loose pictures and a circle, without a store, and written for other programs") {
  const Lights lights;
  const test::Outcome outcome = lights.run({"--circles", lights.folder / "balls.toml", "--out", lights.folder / "out"});
  INFO(outcome.err);
  REQUIRE(outcome.status == 0);
  const auto found = outcome.json().at("lights");
  REQUIRE(found.size() == 11);
  for (const auto& light : found) {
    INFO(light.dump());
    CHECK(light.at("used") == true);
    CHECK(light.at("reason") == "");
    CHECK(light.at("sigma_deg") > 0);
    CHECK(lights.error_degrees(light) < 0.2);
  }
  CHECK(found[9].at("picture") == "light10.png");
  CHECK(core::read_lp(lights.folder / "out" / "lights.lp").size() == 11);
  std::ifstream dome(lights.folder / "out" / "lights.dome");
  const auto json = nlohmann::json::parse(dome);
  CHECK(json.at("lightConfiguration") == "directional");
  CHECK(json.at("directions").at(3).at("z").get<double>() == Approx(lights.truth[3].z).margin(0.003));
  CHECK(fs::file_size(lights.folder / "out" / "lights.csv") > 300);
  CHECK(core::read_image(lights.folder / "out" / "lights.png").width() > 600);
}

TEST_CASE("a ball is detected in the mean of the pictures, or in one that shows its outline") {
  const Lights lights;
  std::ofstream(lights.folder / "none.toml") << "encoding = \"linear\"\n";
  const test::Outcome detected = lights.run({"--circles", lights.folder / "none.toml", "--detect"});
  INFO(detected.err);
  REQUIRE(detected.status == 0);
  for (const auto all = detected.json().at("lights"); const auto& light : all) CHECK(lights.error_degrees(light) < 0.4);

  core::write_image(lights.folder / "mask.png", ball_under({0, 0, 1}, 0, true), {.encoding = core::Encoding::kLinear});
  std::ofstream(lights.folder / "mask.toml") << "encoding = \"linear\"\n[[ball]]\noutline = \"mask.png\"\n";
  const test::Outcome masked = lights.run({"--circles", lights.folder / "mask.toml"});
  INFO(masked.err);
  REQUIRE(masked.status == 0);
  REQUIRE(masked.json().at("lights").size() == 11);
  for (const auto all = masked.json().at("lights"); const auto& light : all) CHECK(lights.error_degrees(light) < 0.4);
}

TEST_CASE("lights that cannot be placed are named with the reason") {
  const Lights lights;
  lights.write(1, core::Image(112, 124, 1));                 // dead
  lights.write(2, ball_under(lights.truth[2], 0, true));     // hidden: the ball is lit, nothing shines on it
  core::Image two = ball_under(lights.truth[3], 0.8, true);  // double
  const core::Image second = ball_under(lights.truth[8], 0.7, false);
  for (std::size_t k = 0; k < two.values().size(); ++k) two.values()[k] += second.values()[k];
  lights.write(3, two);
  core::Image white(112, 124, 1);
  std::fill(white.values().begin(), white.values().end(), 1.0F);
  lights.write(4, white);
  const test::Outcome outcome = lights.run({"--circles", lights.folder / "balls.toml"});
  INFO(outcome.err);
  REQUIRE(outcome.status == 0);
  const auto found = outcome.json().at("lights");
  CHECK(outcome.json().at("placed") == 7);
  const auto reason = [&](std::size_t i) { return found.at(i).at("reason").get<std::string>(); };
  CHECK(reason(1).starts_with("dead"));
  CHECK(reason(2).starts_with("hidden"));
  CHECK(reason(3).starts_with("double"));
  CHECK(reason(4).starts_with("overexposed"));
  CHECK(found[4].at("direction").is_null());
  CHECK(found[5].at("used") == true);
}

TEST_CASE("two balls seen by known cameras give the lights' positions") {
  const test::TemporaryFolder folder;
  // Each camera looks straight at its ball, so that the ball's image is a circle.
  constexpr double kDistance = 1.9, kFocal = 2400, kBall = 0.06;
  constexpr int kPixels = 200;
  const double radius = kFocal * std::tan(std::asin(kBall / kDistance));
  std::ofstream toml(folder / "rig.toml");
  toml << "encoding = \"linear\"\n";
  std::vector<core::Vec3> truth;
  for (int i = 0; i < 9; ++i) {
    truth.push_back(core::Direction::from_longitude_latitude_degrees(-60 + 15 * i, 12 * (i % 4) - 20).vec() *
                    (1.2 + 0.15 * i));
  }
  for (const auto& [name, x] : {std::pair{"left", -0.25}, std::pair{"right", 0.25}}) {
    core::CameraModel camera = core::look_at({x, 0, kDistance}, {x, 0, 0}, kPixels, kPixels, 10);
    camera.fx = camera.fy = kFocal;
    camera.cx = camera.cy = 99.5;
    toml << "[[camera]]\nname = \"" << name << "\"\nfocal_length_pixels = [2400, 2400]\n"
         << "principal_point_pixels = [99.5, 99.5]\nposition_m = [" << x << ", 0, 1.9]\n"
         << "right = [1, 0, 0]\ndown = [0, -1, 0]\nforward = [0, 0, -1]\n"
         << "[[ball]]\nname = \"" << name << " ball\"\ncamera = \"" << name << "\"\nfolder = \"" << name
         << "\"\nradius_m = 0.06\ncircle = [99.5, 99.5, " << radius << "]\ncircle_sigma_px = 0.01\n";
    fs::create_directory(folder / name);
    for (std::size_t i = 0; i < truth.size(); ++i) {
      const auto at = calib::predict_highlight(camera, {{x, 0, 0}, kBall, 0, 0}, truth[i]);
      REQUIRE(at);
      core::Image image(kPixels, kPixels, 1);
      for (int y = 0; y < kPixels; ++y) {
        for (int c = 0; c < kPixels; ++c) {
          image(y, c) = float(0.8 * std::exp(-0.5 * (std::pow(c - at->x, 2) + std::pow(y - at->y, 2)) / 1.44));
        }
      }
      core::write_image(fs::path(folder / name) / ("light" + std::to_string(i) + ".png"), image,
                        {.pixel_type = core::PixelType::kUint16, .encoding = core::Encoding::kLinear});
    }
  }
  toml.close();
  const test::Outcome outcome =
      test::run_program(folder / "no store", {"calibrate", "lights", "--balls", folder.path().string(), "--circles",
                                              folder / "rig.toml", "--out", folder / "out", "--json"});
  INFO(outcome.err);
  REQUIRE(outcome.status == 0);
  CHECK(outcome.json().at("rms_px") < 0.02);
  for (const auto all = outcome.json().at("lights"); const auto& light : all) {
    INFO(light.dump());
    REQUIRE(light.at("used") == true);
    const auto& p = light.at("position");
    const core::Vec3 off = core::Vec3{p[0], p[1], p[2]} - truth.at(light.at("index").get<std::size_t>());
    CHECK(norm(off) < 0.02);
    CHECK(norm(off) < 4 * light.at("sigma_m").get<double>());
  }
  std::ifstream dome(folder / "out" / "lights.dome");
  CHECK(nlohmann::json::parse(dome).at("positions3d").size() == 9);
}

TEST_CASE("what does not fit together is refused with one line that says what") {
  const Lights lights;
  const auto refused = [&](const std::string& toml, const std::string& said, int status = 3) {
    std::ofstream(lights.folder / "bad.toml") << toml;
    const test::Outcome outcome = lights.run({"--circles", lights.folder / "bad.toml"});
    INFO(toml << "\n" << outcome.err);
    CHECK(outcome.status == status);
    CHECK(outcome.err.find(said) != std::string::npos);
  };
  refused("pictures = \"nothing*\"\n[[ball]]\ncircle = [1, 2, 3]\n", "nothing*");
  refused("[[ball]]\ncircle = [1, 2, -3]\n", "circle");
  refused("[[ball]]\n", "--detect");
  refused("[[ball]]\ncircl = [1, 2, 3]\n", "circl");
  refused("stage_radius_m = 1.5\n[[ball]]\ncircle = [61, 55, 40]\n", "radius_m");
  refused("encoding = \"raw\"\n", "encoding");
  refused("[[camera]]\nfocal_length_pixels = [900, 900]\nprincipal_point_pixels = [62, 56]\n", "ball");
  refused("[[ball]]\ncircle = [-61, 55, 40]\n", "outside the pictures");
  refused("[[ball]]\nname = \"a\"\ncircle = [61, 55, 40]\n[[ball]]\nname = \"a\"\ncircle = [61, 55, 40]\n", "twice");
  CHECK(lights.run({}).status == 2);
  core::write_image(lights.folder / "light9999.png", core::Image(20, 30, 3));
  for (const std::vector<std::string>& how :
       {std::vector<std::string>{"--detect"}, {"--circles", (lights.folder / "balls.toml").string()}}) {
    const test::Outcome outcome = lights.run(how);
    CHECK(outcome.status == 3);
    CHECK(outcome.err.find("light9999.png: is 30 x 20 pixels") != std::string::npos);
  }
  CHECK(test::run_program(lights.folder / "no store", {"calibrate"}).status == 2);
}
