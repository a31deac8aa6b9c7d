// Whole passes without faults, in each timing mode: what is stored, how fast it went.
#include <catch2/catch.hpp>

#include "capture/hardware_rig.h"
#include "hil/scenarios/scenario.h"

namespace lightstage::hil {

namespace {

double steps_per_second(const capture::SessionReport& report) {
  return static_cast<double>(report.steps) / (static_cast<double>(report.duration - report.preparation) / 1e9);
}

void run_pass(const std::string& name, const capture::Stage& stage, capture::Timing timing) {
  Scenario scenario(name);
  const capture::Sequence sequence = make_rig_sequence(stage, {.timing = timing});
  const capture::SessionReport report = scenario.capture(stage, sequence);
  CHECK(report.stored == report.steps * stage.cameras.size());
  scenario.report().add_figure("steps_per_s", steps_per_second(report));
  scenario.require_all_right(stage);
}

// The same once more with nothing stored: how fast the devices go by themselves.
void run_timed_pass(const std::string& name, const capture::Stage& stage, capture::Timing timing) {
  run_pass(name, stage, timing);
  Scenario scenario(name + "_dry");
  const capture::SessionReport report = scenario.dry_run(stage, make_rig_sequence(stage, {.timing = timing}));
  scenario.report().add_frame(report.steps * stage.cameras.size());
  scenario.report().add_retaken(report.retaken);
  scenario.report().add_figure("steps_per_s", steps_per_second(report));
  scenario.report().add_figure("preparation_s", static_cast<double>(report.preparation) / 1e9);
  if (stage.hardware.trigger) scenario.report().add_figure("trigger_to_frame_ms", scenario.trigger_to_frame_ms());
  REQUIRE(EmulatedRig::instance().state()["lit"] == 0);
  scenario.report().pass();
}

}  // namespace

TEST_CASE("a pass over 100 lights in lockstep", "[rig][pass]") {
  run_timed_pass("lockstep", make_rig_stage(), capture::Timing::kLockstep);
}

TEST_CASE("a pass in pictures of 320 x 240", "[rig][pass]") {
  run_pass("large_pictures", make_rig_stage({.lights = 20, .width = 320}), capture::Timing::kLockstep);
}

TEST_CASE("a pass over 100 lights, pipelined", "[rig][pass]") {
  run_timed_pass("pipelined", make_rig_stage(), capture::Timing::kPipelined);
}

TEST_CASE("a pass over 100 lights with cameras that run free", "[rig][pass]") {
  const FreeRunningCameras free(true);
  run_timed_pass("free_run", make_rig_stage({.width = 80, .free_running = true}), capture::Timing::kFreeRun);
}

TEST_CASE("a pass with one trigger line for all cameras", "[rig][pass]") {
  run_pass("common_trigger", make_rig_stage({.lights = 20, .common_trigger = true}), capture::Timing::kLockstep);
}

TEST_CASE("a pass in colour", "[rig][pass]") {
  run_pass("colour", make_rig_stage({.lights = 8, .pixel_formats = {"RG16", "YUYV"}, .width = 320}),
           capture::Timing::kLockstep);
}

TEST_CASE("the strobe line confirms exposures", "[rig][pass]") {
  Scenario scenario("strobe");
  // Long exposures: the driver of this GPIO chip looks at its lines every 40 ms.
  const capture::Stage stage = make_rig_stage({.lights = 4, .strobe = true});
  core::SystemClock clock;
  capture::HardwareRig hardware(stage, clock);
  const capture::Rig rig = hardware.rig();
  REQUIRE(rig.strobe != nullptr);
  for (capture::Camera* camera : rig.cameras) camera->set_exposure(150 * core::kMillisecond);
  for (int i = 0; i < 4; ++i) {
    rig.strobe->clear();
    const core::Nanoseconds fired = clock.now();
    rig.trigger->fire();
    const auto heard = rig.strobe->wait_exposure(fired + core::kSecond);
    REQUIRE(heard);
    CHECK(*heard >= fired);
    CHECK(*heard - fired < 150 * core::kMillisecond);
    for (capture::Camera* camera : rig.cameras) CHECK(camera->wait_frame(clock.now() + core::kSecond));
    clock.sleep_until(fired + 300 * core::kMillisecond);
    scenario.report().add_frame(rig.cameras.size());
  }
  rig.strobe->clear();
  CHECK_FALSE(rig.strobe->wait_exposure(clock.now() + 200 * core::kMillisecond));
  scenario.report().pass();
}

}  // namespace lightstage::hil
