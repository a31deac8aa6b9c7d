// Whole passes without faults, in each timing mode: what is stored, how fast it went.
#include <catch2/catch.hpp>

#include "hil/scenarios/scenario.h"

namespace lightstage::hil {

namespace {

double steps_per_second(const capture::SessionReport& report) {
  return static_cast<double>(report.steps) / (static_cast<double>(report.duration) / 1e9);
}

// The switch on their backs.
struct FreeRunningCameras {
  FreeRunningCameras() { set("free"); }
  ~FreeRunningCameras() { set("triggered"); }
  static void set(const std::string& mode) {
    for (const char* camera : {"cam0", "cam1"}) EmulatedRig::instance().command(mode + " " + camera);
  }
};

void run_pass(const std::string& name, const capture::Stage& stage, capture::Timing timing) {
  Scenario scenario(name);
  const capture::SessionReport report = scenario.capture(stage, make_rig_sequence(stage, {.timing = timing}));
  CHECK(report.stored == report.steps * stage.cameras.size());
  scenario.report().add_figure("steps_per_s", steps_per_second(report));
  if (stage.hardware.trigger) scenario.report().add_figure("trigger_to_frame_ms", scenario.trigger_to_frame_ms());
  scenario.require_all_right(stage);
}

}  // namespace

TEST_CASE("a pass over 100 lights in lockstep", "[rig][pass]") {
  run_pass("lockstep", make_rig_stage(), capture::Timing::kLockstep);
}

TEST_CASE("a pass over 100 lights, pipelined", "[rig][pass]") {
  run_pass("pipelined", make_rig_stage(), capture::Timing::kPipelined);
}

TEST_CASE("a pass over 100 lights with cameras that run free", "[rig][pass]") {
  const FreeRunningCameras free;
  run_pass("free_run", make_rig_stage({.small_frames = true, .free_running = true}), capture::Timing::kFreeRun);
}

TEST_CASE("a pass with one trigger line for all cameras", "[rig][pass]") {
  run_pass("common_trigger", make_rig_stage({.lights = 20, .small_frames = true, .common_trigger = true}),
           capture::Timing::kLockstep);
}

TEST_CASE("a pass in colour", "[rig][pass]") {
  run_pass("colour", make_rig_stage({.lights = 8, .pixel_formats = {"RG16", "YUYV"}}), capture::Timing::kLockstep);
}

}  // namespace lightstage::hil
