// `relight` under environments: what it is asked to keep, what it says it kept, and what it refuses.
#include <algorithm>
#include <catch2/catch.hpp>
#include <cmath>
#include <fstream>

#include "cli/darkroom.h"
#include "core/image_file.h"

using namespace lightstage;

namespace {

class Studio : public test::Darkroom {
 public:
  Studio() {
    core::Image map(12, 24, 3);
    for (float& v : map.values()) v = 0.1f;
    for (int c = 0; c < 3; ++c) map(3, 9, c) = 30;
    core::write_image(*this / "sky.exr", map);
    std::ofstream(*this / "hurt.exr") << "no picture";
  }

  test::Outcome relight(std::vector<std::string> arguments) const {
    arguments.insert(arguments.begin(), {"relight", "ball", "--quiet", "--json"});
    return run(arguments);
  }

  nlohmann::json lit(const std::vector<std::string>& arguments) const {
    const test::Outcome outcome = relight(arguments);
    INFO(outcome.err);
    REQUIRE(outcome.status == 0);
    return outcome.json();
  }
};

double relative_rms(const core::Image& picture, const core::Image& truth) {
  REQUIRE(picture.size() == truth.size());
  double difference = 0, all = 0;
  for (std::size_t i = 0; i < picture.values().size(); ++i) {
    difference += std::pow(double(picture.values()[i]) - double(truth.values()[i]), 2);
    all += std::pow(double(truth.values()[i]), 2);
  }
  return std::sqrt(difference / all);
}

}  // namespace

TEST_CASE("an environment is carried within the error that is asked for, and the exhaustive answer is there to compare",
          "[relight]") {
  const Studio studio;
  const std::string sky = studio / "sky.exr";
  const nlohmann::json exact = studio.lit({"--env", sky, "--exhaustive", "--out", studio / "exact.exr"});
  CHECK(exact.at("directions_exhaustive") == 12 * 24);
  CHECK(exact.at("directions_synthesised") == 12 * 24);
  CHECK(exact.at("error_estimate") == 0);

  const nlohmann::json near = studio.lit(
      {"--env", sky, "--method", "auto", "--error", "0.05", "--error-measure", "rms", "--out", studio / "near.exr"});
  CHECK(near.at("method") == "blend");
  CHECK(near.at("directions_synthesised").get<int>() < 12 * 24);
  CHECK(near.at("directions_synthesised").get<int>() > 0);
  CHECK(near.at("directions_captured") == 24);
  CHECK(near.at("error_estimate").get<double>() <= 0.05);
  CHECK(near.at("error_estimate") == near.at("plan").at("relative_rms_estimate"));
  CHECK(near.at("plan").at("lights").size() == near.at("plan").at("represented"));
  CHECK(near.at("peak_rss_bytes").get<double>() > 1e6);
  CHECK(relative_rms(core::read_image(studio / "near.exr"), core::read_image(studio / "exact.exr")) <= 0.05);

  const nlohmann::json small =
      studio.lit({"--env", sky, "--exhaustive", "--size", "8x4", "--out", studio / "small.exr"});
  CHECK(small.at("directions_exhaustive") == 8 * 4);
  const nlohmann::json linear = studio.lit({"--env", sky, "--method", "linear", "--out", studio / "linear.exr"});
  CHECK(linear.at("directions_synthesised") == 0);
  CHECK(linear.at("error_estimate") == 0);
}

TEST_CASE("an explanation tells what would be synthesised and writes nothing", "[relight]") {
  const Studio studio;
  const nlohmann::json said = studio.lit({"--env", studio / "sky.exr", "--error", "0.001", "--explain"});
  const nlohmann::json plan = said.at("plans").at(0);
  CHECK(plan.at("method") == "blend");
  CHECK(plan.at("directions_synthesised").get<int>() >= 1);
  CHECK(plan.at("lights").at(0).at("nearest_captured").size() == 8);
  CHECK(plan.at("expected_seconds").get<double>() > 0);
  CHECK(plan.at("expected_error").get<double>() <= 0.001);
  for (const auto all = studio.run({"store", "show", "ball", "--json"}).json().at("products");
       const nlohmann::json& product : all)
    CHECK(product.at("kind") != "picture");
}

TEST_CASE("an explanation of a turn plans each of its frames, and one that stands still once", "[relight]") {
  const Studio studio;
  const nlohmann::json turn = studio.lit({"--env", studio / "sky.exr", "--error", "0.01", "--turn", "3", "--explain"});
  const nlohmann::json& plans = turn.at("plans");
  REQUIRE(plans.size() == 3);
  double seconds = 0;
  for (int frame = 0; frame < 3; ++frame) {
    CHECK(plans.at(frame).at("frame") == frame);
    CHECK(plans.at(frame).at("rotate_deg").get<double>() == Approx(120 * frame));
    seconds += plans.at(frame).at("expected_seconds").get<double>();
  }
  CHECK(turn.at("expected_seconds").get<double>() == Approx(seconds));
  std::ofstream(studio / "still.toml") << "frames = 4\n[environment]\nfile = \"sky.exr\"\n[[light]]\n"
                                          "[[light.key]]\ntime_s = 0\ndirection = [0, 0]\n"
                                          "[[light.key]]\ntime_s = 1\ndirection = [40, 0]\n";
  CHECK(studio.lit({"--rig", studio / "still.toml", "--error", "0.01", "--explain"}).at("plans").size() == 1);
}

TEST_CASE("an explanation for people shows the first twenty lights and counts the others", "[relight]") {
  const Studio studio;
  core::Image spots(12, 24, 3);
  for (int i = 0; i < 12 * 24; ++i)
    for (int c = 0; c < 3; ++c) spots(i / 24, i % 24, c) = i % 7 == 3 ? float(1 + i % 5) : 0.0f;
  core::write_image(studio / "spots.exr", spots);
  const test::Outcome told =
      studio.run({"relight", "ball", "--env", studio / "spots.exr", "--error", "1e-6", "--explain"});
  INFO(told.err);
  REQUIRE(told.status == 0);
  const nlohmann::json plan =
      studio.lit({"--env", studio / "spots.exr", "--error", "1e-6", "--explain"}).at("plans").at(0);
  const std::size_t all = plan.at("lights").size();
  REQUIRE(all > 20);
  CHECK_THAT(told.out, Catch::Contains("and " + std::to_string(all - 20) + " more"));
  CHECK(std::count(told.out.begin(), told.out.end(), '\n') == 1 + 1 + 20 + 1);
  CHECK(plan.at("lights").back().at("nearest_captured").size() == 8);
}

TEST_CASE("the pictures that are synthesised for one are told as progress, of a known number where it is known",
          "[relight]") {
  const Studio studio;
  const auto told = [&](std::vector<std::string> arguments) {
    arguments.insert(arguments.begin(), {"relight", "ball", "--method", "blend", "--out", studio / "told.exr"});
    const test::Outcome outcome = studio.run(arguments);
    INFO(outcome.err);
    REQUIRE(outcome.status == 0);
    return outcome.err;
  };
  CHECK_THAT(told({"--light", "0,20", "--radius", "5", "--samples", "7"}),
             Catch::Contains("synthesising pictures: 7/7 in"));
  CHECK_THAT(told({"--env", studio / "sky.exr", "--size", "4x2", "--exhaustive"}),
             Catch::Contains("synthesising pictures: 8 in"));
  CHECK_THAT(told({"--light", "0,20"}), !Catch::Contains("synthesising"));
  CHECK_THAT(told({"--light", "0,20", "--radius", "5", "--samples", "7", "--quiet"}), !Catch::Contains("synthesising"));
}

TEST_CASE("goals that contradict each other, or make no sense, are refused", "[relight]") {
  const Studio studio;
  const std::string sky = studio / "sky.exr", out = studio / "x.exr";
  const auto refused = [&](std::vector<std::string> arguments, int status, const std::vector<std::string>& words) {
    const test::Outcome outcome = studio.relight(arguments);
    CAPTURE(arguments, outcome.err);
    CHECK(outcome.status == status);
    for (const std::string& word : words) CHECK_THAT(outcome.err, Catch::Contains(word));
    CHECK_FALSE(std::filesystem::exists(out));
  };
  refused({"--env", sky, "--error", "0.01", "--budget", "3s", "--out", out}, 2, {"one of --error, --budget"});
  refused({"--env", sky, "--quality", "good", "--exhaustive", "--out", out}, 2, {"one of --error, --budget"});
  refused({"--env", sky, "--error", "0", "--out", out}, 2, {"--error"});
  refused({"--env", sky, "--error", "nan", "--out", out}, 2, {"--error"});
  refused({"--env", sky, "--budget", "soon", "--out", out}, 2, {"--budget", "20s"});
  refused({"--env", sky, "--budget", "-2s", "--out", out}, 2, {"--budget", "20s"});
  refused({"--env", sky, "--quality", "best", "--out", out}, 2, {"--quality"});
  refused({"--env", sky, "--size", "256", "--out", out}, 2, {"--size", "256x128"});
  refused({"--env", sky, "--size", "32768x32768", "--out", out}, 2, {"--size", "32768x32768", "16384x8192"});
  refused({"--env", sky, "--size", "0x4", "--out", out}, 2, {"--size"});
  refused({"--light", "0,0", "--error", "0.01", "--out", out}, 2, {"for environments"});
  refused({"--light", "0,0", "--explain"}, 2, {"for environments"});
  refused({"--env", sky, "--budget", "1s", "--explain"}, 2, {"--explain"});
  refused({"--env", sky}, 2, {"--out"});
  refused({"--env", studio / "hurt.exr", "--out", out}, 3, {"hurt.exr"});
}
