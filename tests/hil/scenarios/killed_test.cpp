// The capturing process is killed in the middle of a pass.
#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <catch2/catch.hpp>
#include <cstdlib>

#include "capture/hardware_rig.h"
#include "hil/scenarios/scenario.h"
#include "hil/scenarios/wait.h"

namespace lightstage::hil {

namespace {

capture::Stage victims_stage() {
  return make_rig_stage();
}

// What the victim does: everything that a capturing program does.
void take_pass(const std::filesystem::path& folder) {
  db::Store store = db::Store::open(folder);
  core::SystemClock clock;
  const capture::Stage stage = victims_stage();
  capture::HardwareRig hardware(stage, clock);
  capture::run_session(store, store.scan("pass"), make_rig_sequence(stage), hardware.rig());
}

// Forked before there are any threads, because starting a program takes long in the virtual machine. It waits for the folder of
// a store, and takes a pass into it.
class Victim {
 public:
  static Victim& instance() {
    static Victim victim;
    return victim;
  }

  pid_t process() const { return process_; }
  void start(const std::filesystem::path& folder) const {
    REQUIRE(write(commands_[1], folder.c_str(), folder.string().size()) > 0);
  }

 private:
  Victim() {
    if (pipe(commands_.data()) != 0) std::abort();
    process_ = fork();
    if (process_ != 0) {
      close(commands_[0]);
      return;
    }
    close(commands_[1]);
    std::array<char, 4096> folder{};
    // Nothing to read: the tests are over.
    if (read(commands_[0], folder.data(), folder.size() - 1) > 0) take_pass(folder.data());
    _exit(0);
  }

  std::array<int, 2> commands_{};
  pid_t process_ = -1;
};

struct ForkFirst : Catch::TestEventListenerBase {
  using TestEventListenerBase::TestEventListenerBase;
  void testRunStarting(const Catch::TestRunInfo&) override { Victim::instance(); }
};
CATCH_REGISTER_LISTENER(ForkFirst)

}  // namespace

TEST_CASE("after SIGKILL the lights go off within 500 ms, and the pass is resumed", "[rig][killed]") {
  Scenario scenario("killed");
  EmulatedRig& rig = EmulatedRig::instance();
  core::SystemClock clock;
  const capture::Stage stage = victims_stage();
  const capture::Sequence sequence = make_rig_sequence(stage);
  scenario.add_scan(stage, sequence);

  const Victim& victim = Victim::instance();
  victim.start(scenario.store_folder());
  // In the middle, with a light on.
  const auto in_the_middle = [&] {
    const nlohmann::json state = rig.state();
    return state["exposures"] >= 150 && state["lit"] > 0;
  };
  const bool began = holds_within(60 * core::kSecond, in_the_middle);
  kill(victim.process(), SIGKILL);
  int status = 0;
  waitpid(victim.process(), &status, 0);
  // What it had sent is with the controller by now.
  const core::Nanoseconds killed = clock.now();
  REQUIRE(began);
  REQUIRE((WIFSIGNALED(status) && WTERMSIG(status) == SIGKILL));
  scenario.report().add_fault();

  REQUIRE(holds_within(5 * core::kSecond, [&] { return rig.dark_from(killed).has_value(); }));
  const core::Nanoseconds dark_after = *rig.dark_from(killed) - killed;
  CHECK(dark_after <= 500 * core::kMillisecond);
  scenario.report().add_figure("dark_after_ms", static_cast<double>(dark_after) / 1e6);

  const capture::SessionReport report = scenario.capture(stage, sequence);
  // Frames are stored a little later than they are taken.
  CHECK(report.already_stored > 0);
  CHECK(report.stored > 0);
  CHECK(report.already_stored + report.stored == 2 * report.steps);
  scenario.require_all_right(stage);
}

}  // namespace lightstage::hil
