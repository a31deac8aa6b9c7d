// The LED controller on another host controller driver, where an unplug shows in another way.
#include <catch2/catch.hpp>

#include "capture/usb_leds.h"
#include "core/error.h"
#include "hil/scenarios/functionfs_led.h"
#include "hil/scenarios/report_line.h"
#include "hil/scenarios/wait.h"

namespace lightstage::hil {

TEST_CASE("FunctionFS: a controller that is unplugged and plugged in again", "[functionfs]") {
  ReportLine report("functionfs");
  core::SystemClock clock;
  const std::string serial = "FFS0";
  FunctionFsLed device(serial);
  const auto plugged_in = [&] {
    const auto seen = capture::usb_leds_seen();
    return std::any_of(seen.begin(), seen.end(), [&](const auto& s) { return s.serial == serial; });
  };
  REQUIRE(holds_within(10 * core::kSecond, plugged_in));
  const auto leds = capture::open_usb_leds(serial, {3, 5, 7}, clock);
  const auto show = [&](int light) { leds->show(std::vector<capture::LightLevel>{{light}}); };
  const auto shows = [&](int light) {
    try {
      show(light);
      return true;
    } catch (const core::DeviceError&) {
      return false;
    }
  };

  show(1);
  CHECK(device.lit() == std::vector<int>{5});
  for (int round = 0; round < 3; ++round) {
    device.unplug();
    report.add_fault();
    CHECK_THROWS_AS(show(0), core::DeviceError);
    device.plug();
    REQUIRE(holds_within(10 * core::kSecond, [&] { return shows(2); }));
    CHECK(device.lit() == std::vector<int>{7});
  }
  leds->all_off();
  CHECK(device.lit().empty());
  report.set_lights_left_on(device.lit().size());
  report.pass();
}

}  // namespace lightstage::hil
