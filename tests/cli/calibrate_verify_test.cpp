// Calibrating again, and checking a calibration by another ball pass.
#include <catch2/catch.hpp>

#include "cli/program.h"
#include "support/support.h"

using namespace lightstage;

TEST_CASE("a second ball pass verifies a calibration, and calibrating again without a grey ball keeps the gains") {
  const test::TemporaryFolder folder;
  const std::filesystem::path store = folder / "store";
  const std::string stage = (folder / "stage.toml").string();
  const auto run = [&](std::vector<std::string> arguments) {
    arguments.push_back("--json");
    return test::run_program(store, arguments);
  };
  const auto succeed = [&](const std::vector<std::string>& arguments) {
    const test::Outcome outcome = run(arguments);
    INFO(arguments[0] << ": " << outcome.err);
    REQUIRE(outcome.status == 0);
    return outcome.json();
  };
  succeed({"init"});
  succeed({"stage", "--lights", "14", "--mount-error", "1", "--gain-spread", "0.2", "--out", stage});
  for (const std::string name : {"ball", "ball2"}) {
    succeed({"capture", "--sim", "--mirror-ball", "--stage", stage, "--size", "192", "--name", name, "--seed",
             name == "ball" ? "1" : "2"});
  }
  succeed({"capture", "--sim", "--grey-ball", "--stage", stage, "--size", "96", "--name", "grey"});
  CHECK(run({"calibrate", "verify", "ball"}).status == 2);  // no calibration yet
  const auto first = succeed({"calibrate", "ball", "--grey", "grey"});
  CHECK(first.at("gains_measured") == true);
  CHECK(first.at("gains_from").is_null());

  const test::Outcome itself = run({"calibrate", "verify", "ball"});
  CHECK(itself.status == 2);
  CHECK(itself.err.find("another ball pass") != std::string::npos);
  const auto verified = succeed({"calibrate", "verify", "ball2"});
  INFO(verified.dump());
  CHECK(verified.at("compared") > 10);
  CHECK(verified.at("median_px") < 0.2);
  CHECK(verified.at("median_deg") < 0.2);
  CHECK(verified.at("recalibrate") == false);
  CHECK(verified.at("moved").empty());

  const auto again = succeed({"calibrate", "ball2"});
  CHECK(again.at("gains_measured") == false);
  CHECK(again.at("gains_from").is_string());
  CHECK(succeed({"calibrate", "ball"}).at("gains_from").is_string());
}
