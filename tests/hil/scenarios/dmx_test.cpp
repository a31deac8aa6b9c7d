// A stage whose lights hang on a shop-bought DMX dimmer.
#include <catch2/catch.hpp>

#include "capture/usb_leds.h"
#include "hil/scenarios/scenario.h"
#include "hil/scenarios/wait.h"

namespace lightstage::hil {

TEST_CASE("a pass with a DMX widget, which is unplugged and plugged in again", "[rig][dmx]") {
  Scenario scenario("dmx");
  EmulatedRig& rig = EmulatedRig::instance();
  rig.command("plug dmx");
  const capture::Stage stage = make_rig_stage({.lights = 30, .dmx = true});
  REQUIRE(holds_within(5 * core::kSecond, [] { return !capture::usb_leds_seen().empty(); }));
  scenario.fault("at show 15 unplug dmx 300");
  scenario.capture(stage, make_rig_sequence(stage), {.attempts = 8});
  scenario.require_all_right(stage);
  rig.command("unplug dmx");
}

}  // namespace lightstage::hil
