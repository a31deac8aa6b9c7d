#include <catch2/catch.hpp>

#include "capture/fake_gpio.h"
#include "capture/gpio/trigger.h"
#include "core/error.h"

using namespace lightstage;
using capture::GpioTrigger;
using capture::TriggerSpec;
using Catch::Contains;
using core::kMillisecond;
using test::FakeGpio;

namespace {

constexpr core::Nanoseconds kMicrosecond = 1000;

struct Bench {
  core::VirtualClock clock;
  FakeGpio gpio;
  TriggerSpec spec{"chip", {"a", "b", "c"}, 2 * kMillisecond, false};

  Bench() { gpio.clock = &clock; }
  std::unique_ptr<GpioTrigger> trigger() { return std::make_unique<GpioTrigger>(spec, test::fake_chips(gpio), clock); }
};

std::string message_of(capture::Trigger& trigger) {
  try {
    trigger.fire();
  } catch (const core::DeviceError& error) {
    return error.what();
  }
  return "(no error)";
}

// The real clock, which counts how often one had to sleep.
struct CountingClock final : core::SystemClock {
  void sleep_until(core::Nanoseconds time) override {
    sleeps += time > now() ? 1 : 0;
    SystemClock::sleep_until(time);
  }
  int sleeps = 0;
};

}  // namespace

TEST_CASE("a pulse is as long as asked and sets all lines at once", "[gpio]") {
  Bench bench;
  bench.spec.pulse = GENERATE(core::Nanoseconds(1000), 50 * kMicrosecond, 100 * kMicrosecond, 3 * kMillisecond);
  bench.spec.active_low = GENERATE(false, true);
  const auto trigger = bench.trigger();
  std::vector<core::Nanoseconds> fired;
  for (int i = 0; i < 5; ++i) fired.push_back(trigger->fire());
  REQUIRE(bench.gpio.changes.size() == 10);
  for (std::size_t i = 0; i < 10; i += 2) {
    CHECK(bench.gpio.changes[i].active);
    CHECK(fired[i / 2] == bench.gpio.changes[i].time);
    CHECK(bench.gpio.changes[i + 1].time - bench.gpio.changes[i].time == bench.spec.pulse);
  }
  CHECK(bench.gpio.sets == 10);  // not one for each line
  REQUIRE(bench.gpio.requests.size() == 1);
  CHECK(bench.gpio.requests[0].chip == "chip");
  CHECK(bench.gpio.requests[0].lines == bench.spec.lines);
  CHECK(bench.gpio.requests[0].active_low == bench.spec.active_low);
}

TEST_CASE("what a slow chip takes for a read does not lengthen the pulse", "[gpio]") {
  Bench bench;
  bench.gpio.read_takes = 5 * kMillisecond;
  bench.gpio.set_takes = kMillisecond;
  bench.spec.pulse = GENERATE(50 * kMicrosecond, 4 * kMillisecond, 5 * kMillisecond, 20 * kMillisecond);
  const auto trigger = bench.trigger();
  bench.gpio.reads = 0;
  trigger->fire();
  REQUIRE(bench.gpio.changes.size() == 2);
  // The chip's own time for one change is what remains.
  CHECK(bench.gpio.changes[1].time - bench.gpio.changes[0].time == bench.spec.pulse + kMillisecond);
  CHECK(bench.gpio.reads == (bench.spec.pulse >= 5 * kMillisecond ? 2 : 1));
}

TEST_CASE("real pulses are never short", "[gpio]") {
  CountingClock clock;
  FakeGpio gpio;
  gpio.clock = &clock;
  const core::Nanoseconds pulse = GENERATE(20 * kMicrosecond, 90 * kMicrosecond, 300 * kMicrosecond);
  GpioTrigger trigger({"chip", {"0"}, pulse, false}, test::fake_chips(gpio), clock);
  clock.sleeps = 0;
  for (int i = 0; i < 20; ++i) trigger.fire();
  REQUIRE(gpio.changes.size() == 40);
  for (std::size_t i = 0; i < 40; i += 2) CHECK(gpio.changes[i + 1].time - gpio.changes[i].time >= pulse);
  if (pulse < 100 * kMicrosecond) {
    CHECK(clock.sleeps == 0);
  } else {
    CHECK(clock.sleeps > 10);
  }
}

TEST_CASE("an order that never reached the line is found by reading back", "[gpio]") {
  Bench bench;
  const auto trigger = bench.trigger();
  bench.gpio.ignores_orders[1] = true;
  CHECK_THAT(message_of(*trigger), Contains("GPIO chip lines a b c") && Contains("line b does not become active"));
  CHECK_FALSE(bench.gpio.any_active());
  bench.gpio.ignores_orders[1] = false;
  CHECK(message_of(*trigger) == "(no error)");
}

TEST_CASE("a line that stays active is named and tried again", "[gpio]") {
  Bench bench;
  bench.gpio.set_takes = 1;
  struct StickingClock final : core::Clock {
    explicit StickingClock(FakeGpio& fake) : gpio(fake) {}
    core::Nanoseconds now() const override { return time.now(); }
    void sleep_until(core::Nanoseconds until) override {
      if (armed && gpio.any_active()) gpio.ignores_orders.assign(3, true);  // sticks within the pulse
      time.sleep_until(until);
    }
    FakeGpio& gpio;
    core::VirtualClock time;
    bool armed = false;
  } clock(bench.gpio);
  bench.gpio.clock = &clock;
  GpioTrigger trigger(bench.spec, test::fake_chips(bench.gpio), clock);
  clock.armed = true;
  bench.gpio.sets = 0;
  CHECK_THAT(message_of(trigger), Contains("line a, line b, line c stays active after the pulse"));
  CHECK(bench.gpio.sets == 2 + 3);  // the pulse, and three more tries to end it
  CHECK(bench.gpio.held == 0);
  CHECK_THAT(message_of(trigger), Contains("set inactive, but line a, line b, line c reads active"));
  clock.armed = false;
  bench.gpio.ignores_orders.assign(3, false);
  CHECK(message_of(trigger) == "(no error)");
  CHECK_FALSE(bench.gpio.any_active());
}

TEST_CASE("a chip that cannot tell its outputs is driven all the same", "[gpio]") {
  Bench bench;
  bench.gpio.tells_outputs = false;
  const auto trigger = bench.trigger();
  trigger->fire();
  CHECK(bench.gpio.changes.size() == 2);
  CHECK(bench.gpio.reads == 1);
}

TEST_CASE("lines are left inactive on every way out", "[gpio]") {
  Bench bench;
  SECTION("the order that ends the pulse fails") {
    const auto trigger = bench.trigger();
    bench.gpio.good_sets = 1;
    bench.gpio.failing_sets = GENERATE(1, 2, 3);
    CHECK_THAT(message_of(*trigger), Contains("cannot set"));
    CHECK_FALSE(bench.gpio.any_active());
    CHECK(bench.gpio.held == 0);
  }
  SECTION("the order that begins it reaches some lines and fails") {
    const auto trigger = bench.trigger();
    bench.gpio.failing_sets = 1;
    bench.gpio.levels[2] = true;
    CHECK_THAT(message_of(*trigger), Contains("cannot set"));
    CHECK_FALSE(bench.gpio.any_active());
  }
  SECTION("the trigger is destroyed") {
    auto trigger = bench.trigger();
    bench.gpio.levels[1] = true;  // as a glitch leaves it
    trigger.reset();
    CHECK_FALSE(bench.gpio.any_active());
    CHECK(bench.gpio.held == 0);
  }
  SECTION("the trigger is destroyed while its chip is gone") {
    auto trigger = bench.trigger();
    bench.gpio.plugged_in = false;
    CHECK_NOTHROW(trigger.reset());
    CHECK(bench.gpio.held == 0);
  }
}

TEST_CASE("a mute chip is given up after one order and one to undo it", "[gpio]") {
  Bench bench;
  const auto trigger = bench.trigger();
  bench.gpio.set_takes = bench.gpio.read_takes = 5 * core::kSecond;  // as long as the kernel waits for a CP2112
  bench.gpio.failing_sets = GENERATE(0, 9);                          // some drivers report success all the same
  const core::Nanoseconds before = bench.clock.now();
  CHECK(message_of(*trigger) != "(no error)");
  CHECK(bench.clock.now() - before == 10 * core::kSecond);
  CHECK(bench.gpio.held == 0);
}

TEST_CASE("a chip that was unplugged is opened again by its label", "[gpio]") {
  Bench bench;
  const auto trigger = bench.trigger();
  trigger->fire();
  bench.gpio.plugged_in = false;
  CHECK_THAT(message_of(*trigger), Contains("gone"));
  SECTION("at once") {
    bench.gpio.plugged_in = true;
    CHECK(message_of(*trigger) == "(no error)");
    CHECK(bench.gpio.requests.back().chip == "chip");
  }
  SECTION("after a while") {
    bench.gpio.comes_back_at = bench.clock.now() + 2900 * kMillisecond;
    CHECK(message_of(*trigger) == "(no error)");
  }
  SECTION("never") {
    const core::Nanoseconds before = bench.clock.now();
    CHECK_THAT(message_of(*trigger), Contains("gone"));
    CHECK(bench.clock.now() - before >= 3 * core::kSecond);
    CHECK(bench.clock.now() - before <= 3100 * kMillisecond);
  }
}

TEST_CASE("a chip that is not there at the start is not waited for", "[gpio]") {
  Bench bench;
  bench.gpio.plugged_in = false;
  CHECK_THROWS_AS(bench.trigger(), core::DeviceError);
  CHECK(bench.clock.now() == 0);
}

TEST_CASE("a line that cannot be made inactive is refused at opening", "[gpio]") {
  Bench bench;
  bench.gpio.levels = {false, true, false};
  bench.gpio.ignores_orders = {false, true, false};
  CHECK_THROWS_WITH(bench.trigger(), Contains("line b reads active"));
  CHECK(bench.gpio.held == 0);
}
