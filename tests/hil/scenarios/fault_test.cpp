// What goes wrong with single frames and writes: nothing wrong may be stored, and what was lost is taken again.
#include <catch2/catch.hpp>

#include "hil/scenarios/kernel_module.h"
#include "hil/scenarios/scenario.h"

namespace lightstage::hil {

TEST_CASE("lost frames are taken again", "[rig][faults]") {
  Scenario scenario("lost");
  const capture::Stage stage = make_rig_stage({.lights = 40});
  scenario.fault("at exposure 5 drop cam0");
  scenario.fault("at exposure 17 drop cam1");
  scenario.fault("at exposure 18 drop cam1");  // the retake as well
  scenario.fault("at exposure 30 drop cam0");
  scenario.fault("at exposure 30 drop cam1");
  const auto report = scenario.capture(stage, make_rig_sequence(stage));
  CHECK(report.retaken == 4);
  CHECK(report.dropped == 5);
  scenario.require_all_right(stage);
}

TEST_CASE("short frames and frames with an error flag are taken again", "[rig][faults]") {
  // As loaded, the driver drops them without a word; with nodrop it hands them on, flagged.
  for (const bool nodrop : {false, true}) {
    const ModuleParameter parameter("uvcvideo", "nodrop", nodrop ? "1" : "0");
    Scenario scenario(nodrop ? "damaged_delivered" : "damaged_dropped");
    const capture::Stage stage = make_rig_stage({.lights = 20});
    scenario.fault("at exposure 6 short cam0");
    scenario.fault("at exposure 11 error cam1");
    scenario.fault("at exposure 20 short cam1");
    scenario.fault("at exposure 20 error cam0");
    const auto report = scenario.capture(stage, make_rig_sequence(stage));
    CHECK(report.retaken == 4);
    scenario.require_all_right(stage);
  }
}

TEST_CASE("frames that come twice are stored once", "[rig][faults]") {
  Scenario scenario("duplicated");
  const capture::Stage stage = make_rig_stage({.lights = 40});
  for (const int exposure : {4, 5, 6, 20, 33}) {
    scenario.fault("at exposure " + std::to_string(exposure) + " duplicate cam" + std::to_string(exposure % 2));
  }
  const auto report = scenario.capture(stage, make_rig_sequence(stage));
  CHECK(report.discarded >= 1);
  scenario.require_all_right(stage);
}

TEST_CASE("frames that come late are not taken for others", "[rig][faults]") {
  Scenario scenario("late");
  const capture::Stage stage = make_rig_stage({.lights = 40});
  // Late but in time; just before, just after and well after the session gives it up: the last arrive among the frames of the
  // retake, and of the step that follows.
  int exposure = 3;
  for (const int delay : {60, 490, 499, 502, 505, 508, 512, 520, 540, 600}) {
    scenario.fault("at exposure " + std::to_string(exposure) + " late cam" + std::to_string(exposure % 2) + " " +
                   std::to_string(delay));
    exposure += 5;
  }
  scenario.capture(stage, make_rig_sequence(stage));
  scenario.require_all_right(stage);
}

TEST_CASE("GPIO writes that fail, or have no effect, cost a try", "[rig][faults]") {
  Scenario scenario("gpio_writes");
  const capture::Stage stage = make_rig_stage({.lights = 20});
  scenario.fault("at write 31 refuse gpio 1");
  scenario.fault("at write 60 refuse gpio 1");
  scenario.fault("at write 80 ignore gpio 1");
  scenario.fault("at write 101 ignore gpio 1");
  scenario.capture(stage, make_rig_sequence(stage));
  scenario.require_all_right(stage);
}

TEST_CASE("in the fast modes, too, whatever goes wrong costs frames and stores no wrong one", "[rig][faults]") {
  for (const capture::Timing timing : {capture::Timing::kPipelined, capture::Timing::kFreeRun}) {
    const bool free_running = timing == capture::Timing::kFreeRun;
    Scenario scenario("faults_" + std::string(capture::to_string(timing)));
    const FreeRunningCameras free(free_running);
    const capture::Stage stage = make_rig_stage({.lights = 100, .width = 80, .free_running = free_running});
    // Both modes look at the cameras first: the pass begins after these exposures.
    const int begin = free_running ? 140 : 12;
    const auto fault = [&](int exposure, const std::string& what) {
      scenario.fault("at exposure " + std::to_string(begin + exposure) + " " + what);
    };
    fault(15, "drop cam0");
    fault(26, "duplicate cam1");
    fault(37, "short cam0");
    fault(48, "error cam1");
    fault(59, "late cam0 60");
    fault(70, "late cam1 300");
    fault(81, "drop cam1");
    fault(82, "drop cam1");
    fault(100, "cut led 300");
    const capture::SessionReport report = scenario.capture(stage, make_rig_sequence(stage, {.timing = timing}));
    CHECK(report.retaken > 0);
    scenario.require_all_right(stage);
  }
}

}  // namespace lightstage::hil
