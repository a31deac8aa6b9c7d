// What needs no device; tests/hil has the rest.
#include "capture/hardware_rig.h"

#include <catch2/catch.hpp>

#include "core/error.h"

using namespace lightstage;
using Catch::Contains;

namespace {

capture::Stage drawn_stage() {
  capture::LayoutOptions options;
  options.lights = 3;
  return capture::make_stage("dome", options);
}

}  // namespace

TEST_CASE("a stage that is only drawn has no rig", "[hardware_rig]") {
  core::SystemClock clock;
  capture::Stage stage = drawn_stage();
  CHECK_THROWS_AS(capture::HardwareRig(stage, clock), core::UsageError);
  CHECK_THROWS_WITH(capture::turn_lights_off(stage, clock), Contains("'dome' describes no LED controllers"));
  stage.hardware.controllers = {{"leds", capture::ControllerKind::kLightstage, "no such"}};
  stage.hardware.wiring = {{"leds", {0}}, {"leds", {1}}, {"leds", {2}}};
  CHECK_THROWS_WITH(capture::HardwareRig(stage, clock), Contains("[camera.device]"));
}

TEST_CASE("in an emergency every controller is asked, and those that fail are named", "[hardware_rig]") {
  core::SystemClock clock;
  capture::Stage stage = drawn_stage();
  stage.hardware.controllers = {{"leds", capture::ControllerKind::kLightstage, "no such"},
                                {"rim", capture::ControllerKind::kEnttecDmxUsbPro, "none"}};
  stage.hardware.wiring = {{"leds", {0}}, {"leds", {1}}, {"rim", {2}}};
  const std::vector<std::string> failures = capture::turn_lights_off(stage, clock);
  REQUIRE(failures.size() == 2);
  CHECK_THAT(failures[0], Contains("controller leds: ") && Contains("no such"));
  CHECK_THAT(failures[1], Contains("controller rim: ") && Contains("none"));
}
