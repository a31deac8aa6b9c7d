// The guard of lights that nobody would turn off: processes that die, and ones that do not.
#include <sys/wait.h>
#include <unistd.h>

#include <catch2/catch.hpp>
#include <chrono>
#include <csignal>
#include <filesystem>
#include <functional>
#include <thread>

#include "capture/usb/lights_off_on_death.h"
#include "capture/usb_leds.h"
#include "core/error.h"
#include "support/support.h"

using namespace lightstage;
using capture::LightsOffOnDeath;
namespace fs = std::filesystem;

namespace {

std::vector<std::string> touch(const fs::path& file) {
  return {"/bin/sh", "-c", "echo dark > \"$1\"", "sh", file.string()};
}

bool appears(const fs::path& file, std::chrono::milliseconds within) {
  const auto end = std::chrono::steady_clock::now() + within;
  while (!fs::exists(file) && std::chrono::steady_clock::now() < end) {
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
  }
  return fs::exists(file);
}

// Runs `life` in a process of its own, which does not return from it. Waits until the process is gone.
void in_a_process(const std::function<void()>& life) {
  const pid_t child = fork();
  REQUIRE(child >= 0);
  if (child == 0) {
    life();
    _exit(0);
  }
  int status = 0;
  REQUIRE(waitpid(child, &status, 0) == child);
}

constexpr std::chrono::milliseconds kPatience{10'000}, kLongEnough{300};

}  // namespace

TEST_CASE("a process that is killed with lights on leaves one behind that turns them off", "[dmx-guard]") {
  const test::TemporaryFolder folder;
  in_a_process([&] {
    LightsOffOnDeath guard(touch(folder / "off"));
    guard.lights_on();
    raise(SIGKILL);
  });
  CHECK(appears(folder / "off", kPatience));
}

TEST_CASE("a process whose lights are off leaves nothing to do", "[dmx-guard]") {
  const test::TemporaryFolder folder;
  in_a_process([&] {
    LightsOffOnDeath guard(touch(folder / "never lit"));
    raise(SIGKILL);
  });
  in_a_process([&] {
    LightsOffOnDeath guard(touch(folder / "turned off"));
    guard.lights_on();
    guard.lights_off();
    raise(SIGKILL);
  });
  in_a_process([&] {
    LightsOffOnDeath guard(touch(folder / "clean end"));
    guard.lights_on();
    guard.lights_off();
  });
  std::this_thread::sleep_for(kLongEnough);
  CHECK(fs::is_empty(folder.path()));
}

TEST_CASE("lights that could not be turned off are, by the guard, when it is given up", "[dmx-guard]") {
  const test::TemporaryFolder folder;
  {
    LightsOffOnDeath guard(touch(folder / "off"));
    guard.lights_on();
    guard.lights_on();
    CHECK_FALSE(appears(folder / "off", kLongEnough));
  }
  CHECK(appears(folder / "off", kPatience));
}

TEST_CASE("two guards do not keep each other waiting, and children of the process keep neither", "[dmx-guard]") {
  const test::TemporaryFolder folder;
  in_a_process([&] {
    LightsOffOnDeath first(touch(folder / "first")), second(touch(folder / "second"));
    first.lights_on();
    second.lights_on();
    if (fork() == 0) {
      execl("/bin/sleep", "sleep", "3", nullptr);
      _exit(1);
    }
    // The child has begun its own program when it has let go of the guards; until then it would hold them.
    std::this_thread::sleep_for(std::chrono::milliseconds(100));
    raise(SIGKILL);
  });
  CHECK(appears(folder / "first", std::chrono::milliseconds(2000)));
  CHECK(appears(folder / "second", std::chrono::milliseconds(2000)));
}

TEST_CASE("the machine's own bus can be looked at, and a device that is not there is named", "[dmx-guard]") {
  for (const capture::UsbLedsSeen& seen : capture::usb_leds_seen()) {
    CHECK(seen.vendor_product.size() == 9);
    CHECK(seen.accessible == seen.advice.empty());
  }
  core::SystemClock clock;
  CHECK_THROWS_AS(capture::open_usb_leds("no such serial number", {0}, clock), core::DeviceError);
  CHECK_THROWS_AS(capture::open_dmx_widget("no such serial number", {{1}}, clock), core::DeviceError);
  CHECK_THROWS_AS(capture::usb_lights_off(capture::ControllerKind::kEnttecDmxUsbPro, "no such serial number", clock),
                  core::DeviceError);
}
