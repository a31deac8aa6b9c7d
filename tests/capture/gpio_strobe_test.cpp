#include <catch2/catch.hpp>

#include "capture/fake_gpio.h"
#include "capture/gpio/strobe.h"
#include "core/error.h"

using namespace lightstage;
using capture::GpioStrobe;
using Catch::Contains;
using core::kMillisecond;
using test::FakeGpio;

namespace {

struct Bench {
  core::VirtualClock clock;
  FakeGpio gpio;
  Bench() {
    gpio.clock = &clock;
    clock.sleep_until(core::kSecond);
  }
  core::Nanoseconds in(core::Nanoseconds time) const { return clock.now() + time; }
};

}  // namespace

TEST_CASE("a strobe tells when the exposure began", "[gpio]") {
  Bench bench;
  GpioStrobe strobe({"chip", "7", true}, test::fake_chips(bench.gpio), bench.clock);
  REQUIRE(bench.gpio.requests.size() == 1);
  CHECK(bench.gpio.requests[0].lines == std::vector<std::string>{"7"});
  CHECK(bench.gpio.requests[0].active_low);

  const core::Nanoseconds first = bench.in(3 * kMillisecond), second = bench.in(8 * kMillisecond);
  bench.gpio.edges = {first, second};
  CHECK(strobe.wait_exposure(bench.in(5 * kMillisecond)) == first);
  CHECK_FALSE(strobe.wait_exposure(bench.in(4 * kMillisecond)));
  CHECK(bench.clock.now() == core::kSecond + 7 * kMillisecond);
  CHECK(strobe.wait_exposure(bench.in(4 * kMillisecond)) == second);
}

TEST_CASE("an edge that came already is told after the deadline too", "[gpio]") {
  Bench bench;
  GpioStrobe strobe({"chip", "7"}, test::fake_chips(bench.gpio), bench.clock);
  bench.gpio.edges = {core::kSecond + 5};
  bench.clock.sleep_until(2 * core::kSecond);
  CHECK(strobe.wait_exposure(core::kSecond) == core::kSecond + 5);
}

TEST_CASE("pulses that were not asked for are forgotten", "[gpio]") {
  Bench bench;
  GpioStrobe strobe({"chip", "7"}, test::fake_chips(bench.gpio), bench.clock);
  bench.gpio.edges = {bench.in(1), bench.in(2), bench.in(3), bench.in(kMillisecond)};
  bench.clock.sleep_until(bench.in(10));
  strobe.clear();
  CHECK(strobe.wait_exposure(bench.in(core::kSecond)) == core::kSecond + kMillisecond);
  bench.gpio.edges_never_end = true;
  CHECK_THROWS_WITH(strobe.clear(), Contains("pulses without end"));
}

TEST_CASE("edges that another clock stamped are refused", "[gpio]") {
  Bench bench;
  GpioStrobe strobe({"chip", "7"}, test::fake_chips(bench.gpio), bench.clock);
  // Kernels before 5.7 stamp by the wall clock.
  struct FarEdges final : capture::GpioChips, capture::GpioEdges {
    explicit FarEdges(core::Nanoseconds edge_time) : time(edge_time) {}
    std::unique_ptr<capture::GpioOutputs> open_outputs(const capture::GpioRequest&) override { return nullptr; }
    std::unique_ptr<capture::GpioEdges> open_edges(const capture::GpioRequest&) override {
      return std::make_unique<FarEdges>(time);
    }
    std::optional<core::Nanoseconds> next_edge(core::Nanoseconds) override { return time; }
    void check() override {}
    core::Nanoseconds time;
  };
  const core::Nanoseconds stamp = GENERATE(core::Nanoseconds(1'700'000'000'000'000'000), core::kSecond - 1);
  GpioStrobe far({"chip", "7"}, std::make_unique<FarEdges>(stamp), bench.clock);
  CHECK_THROWS_WITH(far.wait_exposure(bench.in(kMillisecond)), Contains("CLOCK_MONOTONIC"));
}

TEST_CASE("a strobe whose chip is gone says so, and hears again when it is back", "[gpio]") {
  Bench bench;
  GpioStrobe strobe({"chip", "7"}, test::fake_chips(bench.gpio), bench.clock);
  bench.gpio.plugged_in = false;
  CHECK_THROWS_WITH(strobe.wait_exposure(bench.in(kMillisecond)), Contains("gone"));
  CHECK(bench.gpio.held == 0);
  bench.gpio.comes_back_at = bench.in(kMillisecond * 1500);
  bench.gpio.edges = {bench.in(2 * core::kSecond)};
  CHECK(strobe.wait_exposure(bench.in(3 * core::kSecond)));
  CHECK(bench.gpio.requests.size() > 10);  // asked for again and again

  bench.gpio.failing_edges = 1;
  CHECK_THROWS_AS(strobe.clear(), core::DeviceError);
  CHECK(bench.gpio.held == 0);
  CHECK_NOTHROW(strobe.clear());
}
