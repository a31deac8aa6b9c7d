// The capturing process is killed in the middle of a pass.
#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <catch2/catch.hpp>

#include "capture/hardware_rig.h"
#include "tests/hil/scenarios/scenario.h"

namespace lightstage::hil {

namespace {

constexpr const char* kVictimStore = "LIGHTSTAGE_HIL_VICTIM_STORE";

capture::Stage victims_stage() {
  return make_rig_stage({.lights = 60, .small_frames = true});
}

// This program again, running only the test case below.
pid_t start_victim() {
  const pid_t process = fork();
  if (process == 0) {
    execl("/proc/self/exe", "hil_scenarios", "the process that is killed", nullptr);
    _exit(127);
  }
  return process;
}

}  // namespace

// Not a test: what the next one starts and kills.
TEST_CASE("the process that is killed", "[.victim]") {
  const char* folder = std::getenv(kVictimStore);
  REQUIRE(folder != nullptr);
  db::Store store = db::Store::open(folder);
  core::SystemClock clock;
  const capture::Stage stage = victims_stage();
  capture::HardwareRig hardware(stage, clock);
  capture::run_session(store, store.scan("pass"), make_rig_sequence(stage), hardware.rig());
  FAIL("it was not killed");
}

TEST_CASE("after SIGKILL the lights go off within 500 ms, and the pass is resumed", "[rig][killed]") {
  Scenario scenario("killed");
  EmulatedRig& rig = EmulatedRig::instance();
  core::SystemClock clock;
  const capture::Stage stage = victims_stage();
  const capture::Sequence sequence = make_rig_sequence(stage);
  scenario.add_scan(stage, sequence);
  const test::EnvironmentVariable store(kVictimStore, scenario.store_folder());

  const pid_t victim = start_victim();
  REQUIRE(victim > 0);
  // In the middle, with a light on.
  const auto in_the_middle = [&] {
    const nlohmann::json state = rig.state();
    return state["exposures"] >= 60 && state["lit"] > 0;
  };
  const bool began = holds_within(60 * core::kSecond, in_the_middle);
  const core::Nanoseconds killed = clock.now();
  kill(victim, SIGKILL);
  int status = 0;
  waitpid(victim, &status, 0);
  REQUIRE(began);
  REQUIRE((WIFSIGNALED(status) && WTERMSIG(status) == SIGKILL));
  scenario.report().add_fault();

  REQUIRE(holds_within(5 * core::kSecond, [&] { return rig.dark_from(killed).has_value(); }));
  const core::Nanoseconds dark_after = *rig.dark_from(killed) - killed;
  CHECK(dark_after <= 500 * core::kMillisecond);
  scenario.report().add_figure("dark_after_ms", static_cast<double>(dark_after) / 1e6);

  const capture::SessionReport report = scenario.capture(stage, sequence);
  CHECK(report.already_stored >= 40);
  CHECK(report.already_stored < 120);
  scenario.require_all_right(stage);
}

}  // namespace lightstage::hil
