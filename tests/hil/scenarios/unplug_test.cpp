// Devices that vanish in the middle of a pass and come back, or do not answer for a while.
#include <catch2/catch.hpp>

#include "core/error.h"
#include "hil/scenarios/scenario.h"

namespace lightstage::hil {

namespace {

// docs/led-protocol.md
constexpr core::Nanoseconds kSilenceLimit = 500 * core::kMillisecond;

// Long enough for devices that need a second or two to be found again.
const capture::SessionOptions kPatient{.attempts = 8};

void run_with(const std::string& name, std::initializer_list<const char*> faults) {
  Scenario scenario(name);
  const capture::Stage stage = make_rig_stage({.lights = 20});
  for (const char* fault : faults) scenario.fault(fault);
  scenario.capture(stage, make_rig_sequence(stage), kPatient);
  scenario.require_all_right(stage);
}

}  // namespace

TEST_CASE("the LED controller is unplugged in the middle of a transfer and plugged in again", "[rig][unplug]") {
  run_with("led_unplugged",
           {"at exposure 8 cut led 300", "at exposure 15 cut led 50", "at exposure 22 unplug led 300"});
}

TEST_CASE("a camera is unplugged in the middle of an exposure and plugged in again", "[rig][unplug]") {
  run_with("camera_unplugged", {"at exposure 7 unplug cam1 300", "at exposure 15 unplug cam0 50"});
}

TEST_CASE("the GPIO chip comes back under another number", "[rig][unplug]") {
  run_with("gpio_renumbered", {"at write 25 renumber gpio 300", "at write 60 unplug gpio 50"});
}

TEST_CASE("a controller that is mute or stalls for a while", "[rig][unplug]") {
  run_with("led_mute", {"at exposure 5 mute led 1", "at exposure 10 mute led 12", "at exposure 15 stall led 1"});
}

TEST_CASE("a controller that stays mute ends the pass, goes dark by itself, and the pass can be resumed",
          "[rig][unplug]") {
  Scenario scenario("led_stays_mute");
  EmulatedRig& rig = EmulatedRig::instance();
  const capture::Stage stage = make_rig_stage({.lights = 20});
  const capture::Sequence sequence = make_rig_sequence(stage);
  scenario.fault("at exposure 12 mute led 1000000");
  CHECK_THROWS_AS(scenario.capture(stage, sequence), core::DeviceError);
  const auto events = rig.events();
  const auto muted = std::find_if(events.begin(), events.end(), [](const auto& e) { return e["event"] == "fault"; });
  REQUIRE(muted != events.end());
  const core::Nanoseconds when = (*muted)["t"];
  REQUIRE(rig.dark_from(when));
  CHECK(*rig.dark_from(when) - when <= kSilenceLimit);
  scenario.report().add_figure("dark_after_ms", static_cast<double>(*rig.dark_from(when) - when) / 1e6);

  rig.command("mute led 0");
  CHECK(scenario.capture(stage, sequence).already_stored > 0);
  scenario.require_all_right(stage);
}

}  // namespace lightstage::hil
