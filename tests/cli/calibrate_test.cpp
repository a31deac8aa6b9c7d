// Calibrating a simulated stage by the program, against the simulator's truth.
#include <catch2/catch.hpp>

#include "capture/stage.h"
#include "cli/program.h"
#include "core/direction.h"
#include "core/light_list.h"
#include "db/store.h"
#include "sim/world.h"
#include "support/support.h"

using namespace lightstage;

namespace {

class CalibratedStage {
 public:
  CalibratedStage() {
    succeed({"init"});
    succeed({"stage", "--lights", "20", "--mount-error", "1", "--gain-spread", "0.2", "--out", stage_file()});
  }
  std::filesystem::path store() const { return folder / "store"; }
  std::string stage_file() const { return (folder / "stage.toml").string(); }
  test::Outcome run(std::vector<std::string> arguments) const {
    arguments.push_back("--json");
    return test::run_program(store(), arguments);
  }
  nlohmann::json succeed(const std::vector<std::string>& arguments) const {
    const test::Outcome outcome = run(arguments);
    INFO(arguments[0] << ": " << outcome.err);
    REQUIRE(outcome.status == 0);
    return outcome.json();
  }
  void capture(const std::string& ball, const std::string& name, const std::string& at, const std::string& seed) const {
    succeed({"capture", "--sim", ball, "--stage", stage_file(), "--size", "256", "--name", name, "--at", at, "--seed",
             seed});
  }
  std::vector<core::Light> truth() const {
    sim::Simulation simulation;
    simulation.stage = capture::read_stage(stage_file());
    return sim::World(simulation).true_lights();
  }

  const test::TemporaryFolder folder;
};

core::Vec3 vector(const nlohmann::json& v) {
  return {v.at(0), v.at(1), v.at(2)};
}

}  // namespace

TEST_CASE("ball passes with the ball in two places give positions, gains that verify, and files for other programs") {
  const CalibratedStage stage;
  stage.capture("--mirror-ball", "left", "-0.09,0.01,0", "1");
  stage.capture("--mirror-ball", "right", "0.09,-0.01,0", "2");
  stage.capture("--grey-ball", "grey", "0,0,0", "3");
  const auto found = stage.succeed({"calibrate", "left", "right", "--grey", "grey", "--out", stage.folder / "lights"});
  REQUIRE(found.at("placed") == 20);
  CHECK(found.at("rms_px") < 0.1);
  CHECK(found.at("median_sigma_m") < 0.014);
  const std::vector<core::Light> truth = stage.truth();
  std::vector<double> metres;
  double ratio = 0;
  for (const auto& light : found.at("placed_lights")) {
    INFO(light.dump());
    const core::Light& true_light = truth.at(light.at("light").get<std::size_t>());
    metres.push_back(norm(vector(light.at("position")) - *true_light.position));
    CHECK(metres.back() < 4 * light.at("sigma_m").get<double>());
    const double degrees = core::degrees_from_radians(
        core::angle_radians(core::Direction::from_vector(vector(light.at("direction"))), true_light.direction));
    CHECK(degrees < 4 * light.at("sigma_deg").get<double>());
    ratio += std::pow(degrees / light.at("sigma_deg").get<double>(), 2) / 20;
  }
  std::sort(metres.begin(), metres.end());
  CHECK(metres[10] < 0.012);
  // The drawing's distances, taken as good to 1 %, are exact here.
  CHECK(std::sqrt(ratio) > 0.2);
  CHECK(std::sqrt(ratio) < 1.5);
  CHECK(core::read_lp(stage.folder / "lights" / "lights.lp").size() == 20);
  CHECK(std::filesystem::file_size(stage.folder / "lights" / "lights.png") > 1000);
  CHECK(stage.run({"calibrate", "left", "left"}).status == 2);

  // Another grey pass agrees; one in which two lights changed says which.
  stage.capture("--grey-ball", "grey2", "0,0,0", "4");
  const auto verified = stage.succeed({"calibrate", "verify", "grey2"});
  INFO(verified.dump());
  CHECK(verified.at("ball") == "grey");
  CHECK(verified.at("compared") >= 18);
  CHECK(verified.at("recalibrate") == false);
  CHECK(verified.at("median_gain_error") < 0.005);
  CHECK(verified.at("median_percent") < 5);

  db::Store store = db::Store::open(stage.store());
  const db::Scan grey = store.scan("grey2");
  db::NewScan copy = grey;
  copy.name = "grey3";
  const db::Id id = store.add_scan(copy);
  constexpr int kDimmed = 4, kReddened = 7, kDark = 9;
  for (const db::Frame& frame : store.frames(grey.id, grey.cameras.front())) {
    core::Image picture = store.object(frame.object);
    const int light = grey.steps.at(std::size_t(frame.step_index)).light_index.value_or(-1);
    for (std::size_t k = 0; k < picture.values().size(); ++k) {
      if (light == kDimmed) picture.values()[k] *= 0.8F;
      if (light == kReddened && k % 3 == 0) picture.values()[k] *= 1.15F;
      if (light == kDark) picture.values()[k] *= 0.001F;
    }
    db::NewFrame changed = frame;
    changed.scan_id = id;
    store.put_frame(changed, picture);
  }
  const auto changed = stage.succeed({"calibrate", "verify", "grey3"});
  INFO(changed.dump());
  CHECK(changed.at("recalibrate") == true);
  REQUIRE(changed.at("changed").size() == 3);
  CHECK(changed.at("changed")[0].at("light") == kDimmed);
  CHECK(changed.at("changed")[0].at("what").get<std::string>().find("dimmer") != std::string::npos);
  CHECK(changed.at("changed")[1].at("light") == kReddened);
  CHECK(changed.at("changed")[1].at("what").get<std::string>().find("colour") != std::string::npos);
  CHECK(changed.at("changed")[2].at("what") == "is dark");
}
