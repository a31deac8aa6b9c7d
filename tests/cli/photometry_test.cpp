// Exposures, flat fields and colour, through the program.
#include <catch2/catch.hpp>
#include <cmath>
#include <fstream>

#include "cli/program.h"
#include "core/display.h"
#include "core/image_file.h"
#include "support/support.h"

using namespace lightstage;

namespace {

struct Program {
  test::TemporaryFolder folder;
  std::filesystem::path store = folder / "store";

  test::Outcome run(std::vector<std::string> arguments) const {
    arguments.push_back("--json");
    return test::run_program(store, arguments);
  }
  nlohmann::json succeed(const std::vector<std::string>& arguments) const {
    const test::Outcome outcome = run(arguments);
    INFO(arguments.front() << ": " << outcome.err);
    REQUIRE(outcome.status == 0);
    return outcome.json();
  }
  std::string path(const std::string& name) const { return (folder / name).string(); }
};

core::Image ramp(double exposure, core::ImageSize size) {
  core::Image image(size);
  for (int y = 0; y < size.height; ++y) {
    for (int x = 0; x < size.width; ++x) {
      const double light = exposure * 0.03 * std::exp2(7.0 * x / size.width) * (1 + 0.3 * std::sin(y * 0.2));
      for (int c = 0; c < size.channels; ++c) image(y, x, c) = float(std::min(light * (1 - 0.2 * c), 1.0));
    }
  }
  return image;
}

}  // namespace

TEST_CASE("loose exposures are merged, with a response and without, and tell how linear they are") {
  const Program program;
  const core::ImageSize size{96, 160, 3};
  std::vector<std::string> encoded, linear;
  for (const double t : {0.25, 0.5, 1.0, 2.0, 4.0}) {
    const std::string name = std::to_string(int(t * 100));
    core::write_image(program.folder / (name + ".png"), ramp(t, size));
    core::write_image(program.folder / (name + ".tif"), ramp(t, size),
                      {.pixel_type = core::PixelType::kUint16, .encoding = core::Encoding::kLinear});
    encoded.push_back(program.path(name + ".png"));
    linear.push_back(program.path(name + ".tif"));
  }
  const auto command = [](std::vector<std::string> start, const std::vector<std::string>& files,
                          const std::vector<std::string>& rest) {
    start.insert(start.end(), files.begin(), files.end());
    start.insert(start.end(), rest.begin(), rest.end());
    return start;
  };
  const core::Image truth = ramp(0.25, size);
  const auto largest_off = [&](const std::string& file) {
    const core::Image merged = core::read_image(file);
    double largest = 0;
    for (int y = 0; y < size.height; ++y) {
      for (int x = 16; x < size.width - 8; ++x) {
        if (truth(y, x, 0) > 0.7F) continue;
        largest = std::max(largest, std::abs(double(merged(y, x, 0)) / (double(truth(y, x, 0)) * 4) - 1));
      }
    }
    return largest;
  };
  const std::vector<std::string> times{"--exposures", "1/4,1/2,1,2,4"};
  const auto with = [&](std::vector<std::string> more) {
    more.insert(more.begin(), times.begin(), times.end());
    return more;
  };
  const auto merged =
      program.succeed(command({"merge"}, linear, with({"--encoding", "linear", "--out", program.path("linear.exr")})));
  CHECK(merged.at("exposures").get<int>() == 5);
  CHECK(merged.at("saturated_pixels").get<int>() > 0);
  CHECK(largest_off(program.path("linear.exr")) < 0.002);
  program.succeed(command({"merge"}, encoded, with({"--out", program.path("srgb.exr")})));
  CHECK(largest_off(program.path("srgb.exr")) < 0.05);

  const auto response =
      program.succeed(command({"calibrate", "response"}, encoded, with({"--out", program.path("camera")})));
  CHECK(response.at("curve").at(1).size() == 256);
  CHECK(std::filesystem::is_regular_file(program.folder / "camera/response.svg"));
  program.succeed(
      command({"merge"}, encoded,
              with({"--response", program.path("camera/response.csv"), "--out", program.path("response.exr")})));
  // The response knows no scale: the ratio to the truth is one number, to what eight bits allow.
  const core::Image recovered = core::read_image(program.path("response.exr"));
  std::vector<double> ratios;
  for (int x = 40; x < 120; ++x) ratios.push_back(double(recovered(50, x, 0)) / double(truth(50, x, 0)));
  const auto [lowest, highest] = std::minmax_element(ratios.begin(), ratios.end());
  CHECK(*highest / *lowest < 1.15);

  const auto report =
      program.succeed(command({"calibrate", "linearity"}, linear, with({"--out", program.path("camera")})));
  CHECK(report.at("linear") == true);
  CHECK(report.at("clips_at").get<double>() == Approx(1).epsilon(1e-3));
  const auto bent = program.succeed(command({"calibrate", "linearity"}, encoded, times));
  CHECK(bent.at("linear") == false);

  std::ofstream(program.folder / "list.csv")
      << "file,seconds\n25.tif,0.25\n50.tif,1/2\n100.tif,1\n200.tif,2\n400.tif,4\n";
  program.succeed({"merge", "--csv", program.path("list.csv"), "--encoding", "linear", "--out", program.path("b.exr")});
  CHECK(core::read_image(program.path("b.exr")) == core::read_image(program.path("linear.exr")));

  CHECK(program.run(command({"merge"}, linear, {"--exposures", "1,2", "--out", program.path("x.exr")})).status == 2);
  CHECK(program.run(command({"merge"}, linear, {"--exposures", "1,2,3,4,-3", "--out", program.path("x.exr")})).status ==
        2);
  CHECK(program.run({"merge", "--csv", program.path("none.csv"), "--out", program.path("x.exr")}).status == 3);
  std::ofstream(program.folder / "bad.csv") << "25.tif,0.25\n100.tif,soon\n";
  const test::Outcome bad = program.run({"merge", "--csv", program.path("bad.csv"), "--out", program.path("x.exr")});
  CHECK(bad.status == 3);
  CHECK(bad.err.find("bad.csv:2") != std::string::npos);
  std::ofstream(program.folder / "none.csv") << "file,seconds\n";
  CHECK(program.run({"merge", "--csv", program.path("none.csv"), "--out", program.path("x.exr")}).status == 3);
  // Times in another order than the pictures.
  const test::Outcome swapped =
      program.run(command({"merge"}, linear, {"--exposures", "4,2,1,1/2,1/4", "--out", program.path("x.exr")}));
  CHECK(swapped.status == 3);
  CHECK(swapped.err.find("is darker than") != std::string::npos);
  CHECK(program
            .run(command({"merge"}, encoded,
                         with({"--encoding", "srgb", "--response", program.path("camera/response.csv"), "--out",
                               program.path("x.exr")})))
            .status == 2);
  CHECK_FALSE(std::filesystem::exists(program.folder / "x.exr"));
  const test::Outcome bright_dark =
      program.run(command({"merge"}, linear, with({"--dark", linear.back(), "--out", program.path("dark.exr")})));
  CHECK(bright_dark.status == 0);
  CHECK(bright_dark.err.find("--dark is brighter") != std::string::npos);
  // Photographs are never what is written to.
  const core::Image photograph = core::read_image(linear.front());
  CHECK(program.run(command({"merge"}, linear, with({"--out", linear.front()}))).status == 2);
  CHECK(program.run(command({"merge"}, linear, with({"--dark", linear.back(), "--out", linear.back()}))).status == 2);
  CHECK(core::read_image(linear.front()) == photograph);
  CHECK(program.run(command({"merge"}, linear, with({"--out", program.path("x.png")}))).status == 2);
  CHECK_FALSE(std::filesystem::exists(program.folder / "x.png"));
}

TEST_CASE("a pass of a white card gives the camera's flat field, by which frames are divided from then on") {
  const Program program;
  program.succeed({"init"});
  program.succeed({"stage", "--lights", "24", "--out", program.path("stage.toml")});
  program.succeed({"capture", "--sim", "--white-card", "--stage", program.path("stage.toml"), "--size", "128", "--name",
                   "card", "--tracking-every", "0"});
  const auto report = program.succeed({"calibrate", "flat", "--scan", "card", "--out", program.path("camera")});
  const auto& flat = report.at("flat").at(0);
  INFO(report.dump());
  CHECK(report.at("stored") == true);
  for (const auto& corner : flat.at("corner")) CHECK(corner.get<double>() == Approx(0.85).margin(0.0043));
  CHECK(flat.at("condition").get<double>() < 20);
  for (const char* file : {"flat_cam0.exr", "flat_cam0.png", "flat.svg"}) {
    CHECK(std::filesystem::is_regular_file(program.folder / "camera" / file));
  }
  // The card itself, loaded again, is now even: light by light the corners are as bright as the light makes them.
  const core::Image found = core::read_image(program.folder / "camera/flat_cam0.exr");
  double largest = 0;
  for (int y = 0; y < 128; ++y) {
    for (int x = 0; x < 128; ++x) {
      const double r2 = (std::pow(2 * y + 1 - 128, 2) + std::pow(2 * x + 1 - 128, 2)) / (2 * 128.0 * 128.0);
      largest = std::max(largest, std::abs(double(found(y, x, 1)) / (1 - 0.15 * r2) - 1));
    }
  }
  CHECK(largest < 0.005);
  CHECK(program.run({"calibrate", "flat"}).status == 2);
  CHECK(program.run({"calibrate", "flat", "--scan", "card", "--dark", program.path("stage.toml")}).status == 2);
  CHECK(program.run({"calibrate", "flat", "--scan", "card", "--out", program.path("stage.toml")}).status == 3);
  CHECK(program.succeed({"store", "show", "card"}).at("products").size() == 1);
  CHECK(program.run({"calibrate", "flat", "--scan", "cart"}).status == 2);
  CHECK(program.run({"calibrate", "flat", program.path("stage.toml"), "--out", program.path("x")}).status == 3);
  CHECK(program.succeed({"store", "verify"}).at("ok") == true);
}

TEST_CASE("a bracketed pass is taken and loaded as one picture a light") {
  const Program program;
  program.succeed({"init"});
  program.succeed({"stage", "--lights", "16", "--out", program.path("stage.toml")});
  const std::vector<std::string> capture{
      "capture", "--sim", "--procedural", "3",      "--stage", program.path("stage.toml"),
      "--size",  "64",    "--no-motion",  "--name", "head"};
  auto bracketed = capture;
  for (const char* ms : {"5", "20", "80"}) bracketed.insert(bracketed.end(), {"--exposure", ms});
  const auto report = program.succeed(bracketed);
  // Three dark frames of each exposure, full-on, tracking at 0, 10 and the end, three exposures of each light.
  CHECK(report.at("steps").get<int>() == 9 + 1 + 3 + 48);
  CHECK(program.succeed({"capture", "--resume", "--name", "head"}).at("already_stored") == report.at("frames"));
  program.succeed(
      {"capture", "--sim", "--mirror-ball", "--stage", program.path("stage.toml"), "--size", "192", "--name", "ball"});
  program.succeed({"calibrate", "ball"});
  program.succeed({"align", "head"});
  program.succeed({"export", "head", "--out", program.path("out")});
  auto plain = capture;
  plain.back() = "plain";
  program.succeed(plain);
  program.succeed({"export", "plain", "--out", program.path("plain")});
  std::size_t pictures = 0;
  double noise = 0, scale = 0;
  for (const auto& entry : std::filesystem::directory_iterator(program.folder / "out")) {
    if (entry.path().extension() != ".exr") continue;
    ++pictures;
    const core::Image merged = core::read_image(entry.path());
    const core::Image single = core::read_image(program.folder / "plain" / entry.path().filename());
    for (std::size_t i = 0; i < merged.values().size(); ++i) {
      noise += std::abs(double(merged.values()[i]) - double(single.values()[i]));
      scale += double(single.values()[i]);
    }
  }
  CHECK(pictures == 16);
  CHECK(noise / scale < 0.05);
  CHECK(program.succeed({"store", "verify"}).at("ok") == true);
  auto ball = bracketed;
  ball[2] = "--mirror-ball";
  ball.erase(ball.begin() + 3);
  std::replace(ball.begin(), ball.end(), std::string("head"), std::string("other"));
  CHECK(program.run(ball).status == 2);
}

TEST_CASE("colours of a file are applied to imported pictures when they are loaded") {
  const Program program;
  program.succeed({"init"});
  core::Image picture(8, 8, 3);
  for (int i = 0; i < 64; ++i) {
    picture.values()[std::size_t(3 * i)] = 0.2F;
    picture.values()[std::size_t(3 * i + 1)] = 0.4F;
    picture.values()[std::size_t(3 * i + 2)] = 0.1F;
  }
  core::write_image(program.folder / "a.exr", picture, {.pixel_type = core::PixelType::kFloat});
  std::ofstream(program.folder / "lights.csv") << "file,x,y,z\na.exr,0,0,1\n";
  std::ofstream(program.folder / "balanced.csv") << "file,x,y,z,r,g,b\na.exr,0,0,1,1,2,0.5\n";
  std::ofstream(program.folder / "colour.toml")
      << "white_balance = [2.0, 1.0, 4.0]\nred = [0.5, 0.5, 0.0]\ngreen = [0.0, 1.0, 0.0]\nblue = [0.0, -0.5, 1.5]\n";
  const auto loaded = [&](const std::string& csv, const std::string& name) {
    program.succeed({"import", "csv", program.path(csv), "--name", name, "--colour", program.path("colour.toml")});
    program.succeed({"export", name, "--out", program.path(name)});
    for (const auto& entry : std::filesystem::directory_iterator(program.folder / name)) {
      if (entry.path().extension() == ".exr") return core::read_image(entry.path());
    }
    return core::Image();
  };
  const core::Image found = loaded("lights.csv", "mine");
  CHECK(found(3, 3, 0) == Approx(0.4).epsilon(2e-3));
  CHECK(found(3, 3, 1) == Approx(0.4).epsilon(2e-3));
  CHECK(found(3, 3, 2) == Approx(0.4).epsilon(2e-3));
  // The lights' own colours balance the white: 0.2, 0.2, 0.2, and the matrix alone keeps grey grey.
  const core::Image balanced = loaded("balanced.csv", "other");
  for (int c = 0; c < 3; ++c) CHECK(balanced(3, 3, c) == Approx(0.2).epsilon(2e-3));

  std::ofstream(program.folder / "wrong.toml") << "white_balance = [2.0, 0.0, 4.0]\nred = [1.0, 0.0, 0.0]\n";
  const test::Outcome wrong = program.run(
      {"import", "csv", program.path("lights.csv"), "--name", "third", "--colour", program.path("wrong.toml")});
  CHECK(wrong.status == 3);
  CHECK(wrong.err.find("wrong.toml:1") != std::string::npos);
  const test::Outcome chartless =
      program.run({"calibrate", "colour", program.path("a.exr"), "--out", program.path("c")});
  CHECK(chartless.status == 3);
  CHECK(chartless.err.find("a.exr") != std::string::npos);
  CHECK(
      program.run({"calibrate", "colour", program.path("a.exr"), "--out", program.path("c"), "--camera", "x"}).status ==
      2);
}
