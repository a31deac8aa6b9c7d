#include "capture/light_limits.h"

#include <catch2/catch.hpp>
#include <random>

#include "capture/light_schedule.h"
#include "core/error.h"
#include "support/slow_eye.h"

using namespace lightstage;
using capture::FlashMeter;
using capture::LightLimits;
using core::kMillisecond;
using core::kSecond;
using core::Nanoseconds;
using test::LightsAt;

namespace {

using Levels = std::vector<double>;

using Colours = std::vector<test::Colour>;

// When a meter says that there are too many flashes; nothing until `end`.
std::optional<Nanoseconds> too_many(const std::vector<LightsAt>& changes, Nanoseconds end,
                                    const LightLimits& limits = {}) {
  FlashMeter meter(changes.front().levels.size(), limits);
  for (std::size_t i = 0; i < changes.size(); ++i) {
    std::vector<capture::LitLight> lit;
    for (std::size_t l = 0; l < changes[i].levels.size(); ++l) lit.push_back({l, changes[i].levels[l]});
    meter.show(changes[i].time, lit);
    const Nanoseconds until = i + 1 < changes.size() ? changes[i + 1].time : end;
    if (const auto time = meter.too_many(); time && *time < until) return time;
  }
  return std::nullopt;
}

// The two sets of levels in turn, `hz` times a second, the first for this share of the time.
template <class Set>
std::vector<LightsAt> in_turn(double hz, double share, const Set& first, const Set& second,
                              Nanoseconds end = 3 * kSecond) {
  std::vector<LightsAt> changes;
  for (double t = 0; t < double(end); t += 1e9 / hz) {
    changes.emplace_back(Nanoseconds(t), first);
    changes.emplace_back(Nanoseconds(t + 1e9 / hz * share), second);
  }
  return changes;
}

capture::Sequence olat(std::size_t lights, int every, double exposure_ms,
                       capture::Timing timing = capture::Timing::kLockstep) {
  capture::OlatOptions options{.light_count = lights, .tracking_every = every};
  options.exposure = core::from_units(exposure_ms, kMillisecond);
  capture::Sequence sequence = capture::make_olat_sequence(options);
  sequence.timing = timing;
  return sequence;
}

constexpr capture::Pace kFast{.overhead = 0, .period = kSecond / 60};

}  // namespace

TEST_CASE("the whole stage may flash up to three times a second, or faster than an eye follows, and dimly at any rate",
          "[limits]") {
  const Levels full(20, 1.0), dark(20, 0.0);
  for (const double hz : {0.5, 1.0, 2.0, 2.9, 70.0, 100.0, 400.0}) {
    CAPTURE(hz);
    CHECK_FALSE(too_many(in_turn(hz, 0.5, full, dark), 3 * kSecond));
  }
  for (const double hz : {3.2, 4.0, 8.0, 15.0, 25.0, 40.0, 55.0}) {
    CAPTURE(hz);
    const auto time = too_many(in_turn(hz, 0.5, full, dark), 3 * kSecond);
    REQUIRE(time);
    // The fourth flash, and a little later where the first ones run into each other.
    CHECK(double(*time) / 1e9 > 3 / hz);
    CHECK(double(*time) / 1e9 < 1.0);
    CHECK_FALSE(too_many(in_turn(hz, 0.5, Levels(20, 0.09), dark), 3 * kSecond));
    CHECK_FALSE(too_many(in_turn(hz, 0.5, full, Levels(20, 0.91)), 3 * kSecond));
    CHECK_FALSE(too_many(in_turn(hz, 0.5, full, dark), 3 * kSecond, {.strobe_share = 1}));
  }
}

TEST_CASE("short flashes count as their light, not as their peak", "[limits]") {
  const Levels full(20, 1.0), dark(20, 0.0);
  CHECK_FALSE(too_many(in_turn(5, 0.002 * 5, full, dark), 3 * kSecond));  // 2 ms
  CHECK(too_many(in_turn(5, 0.006 * 5, full, dark), 3 * kSecond));        // 6 ms
}

TEST_CASE("short flashes at the rates that eyes mind most are too many, though each is small", "[limits]") {
  const Levels full(20, 1.0), dark(20, 0.0);
  CHECK(too_many(in_turn(22, 0.004 * 22, full, dark), 3 * kSecond));
  CHECK(too_many(in_turn(12, 0.003 * 12, full, dark), 3 * kSecond));
  CHECK_FALSE(too_many(in_turn(8, 0.004 * 8, full, dark), 3 * kSecond));
  CHECK_FALSE(too_many(in_turn(22, 0.0015 * 22, full, dark), 3 * kSecond));
  CHECK_FALSE(too_many(in_turn(22, 0.5, Levels(20, 0.04), dark), 3 * kSecond));
}

TEST_CASE("colours flash each by itself, and saturated red sooner", "[limits]") {
  const auto all = [](double r, double g, double b) { return Colours(20, test::Colour{r, g, b}); };
  const Colours dark = all(0, 0, 0);
  // Full red counts as full light, and red and blue in turn are not steady.
  for (const Colours& colour : {all(1, 0, 0), all(0, 1, 0), all(0, 0, 1), all(1, 1, 0)}) {
    CHECK(too_many(in_turn(10, 0.13, colour, dark), 3 * kSecond));
    CHECK_FALSE(too_many(in_turn(2.5, 0.13, colour, dark), 3 * kSecond));
  }
  CHECK(too_many(in_turn(12.5, 0.5, all(1, 0, 0), all(0, 0, 1)), 3 * kSecond));
  CHECK(too_many(in_turn(12.5, 0.5, all(1, 0, 0), all(1, 1, 1)), 3 * kSecond));
  // Eight parts in a hundred are a flash of red and none of blue or white.
  CHECK(too_many(in_turn(5, 0.5, all(0.08, 0, 0), dark), 3 * kSecond));
  CHECK_FALSE(too_many(in_turn(5, 0.5, all(0.06, 0, 0), dark), 3 * kSecond));
  CHECK_FALSE(too_many(in_turn(5, 0.5, all(0, 0, 0.09), dark), 3 * kSecond));
  CHECK_FALSE(too_many(in_turn(5, 0.5, all(0.09, 0.05, 0.05), dark), 3 * kSecond));
  // Three colours in turn with darkness between: each is lit twice a second, and something flashes six times.
  std::vector<LightsAt> in_three;
  for (int i = 0; i < 18; ++i) {
    const Nanoseconds time = i * kSecond / 6;
    in_three.emplace_back(time, all(i % 3 == 0, i % 3 == 1, i % 3 == 2));
    in_three.emplace_back(time + 20 * kMillisecond, dark);
  }
  CHECK(too_many(in_three, 3 * kSecond));
  // A quarter of the lights, some in red, some in blue.
  Colours some = dark;
  for (std::size_t i = 0; i < 5; ++i) some[i] = i % 2 == 0 ? test::Colour{0.9, 0, 0} : test::Colour{0, 0, 0.9};
  CHECK(too_many(in_turn(5, 0.5, some, dark), 3 * kSecond, {.strobe_share = 0.3}));
  some[4] = {};
  CHECK_FALSE(too_many(in_turn(5, 0.5, some, dark), 3 * kSecond, {.strobe_share = 0.3}));
  // As a pass would.
  capture::Sequence sequence;
  for (int i = 0; i < 24; ++i) {
    std::vector<capture::LightLevel> lit;
    for (int l = 0; l < 12; ++l) lit.push_back({l, i % 2 == 0 ? 1.0F : 0.0F, 0, i % 2 == 0 ? 0.0F : 1.0F});
    sequence.steps.push_back({.step_index = i,
                              .kind = db::StepKind::kPattern,
                              .exposure_ns = 38 * kMillisecond,
                              .pattern = capture::pattern_of(lit)});
  }
  CHECK_FALSE(capture::exceeded_limits(sequence, 12, {}, std::span<const capture::Pace>(&kFast, 1)).empty());
}

TEST_CASE("lights that take turns flash although their sum stays the same", "[limits]") {
  Levels left(20, 0.0), right(20, 1.0);
  std::fill_n(left.begin(), 10, 1.0);
  std::fill_n(right.begin(), 10, 0.0);
  CHECK(too_many(in_turn(10, 0.5, left, right), 3 * kSecond));
  CHECK_FALSE(too_many(in_turn(2.5, 0.5, left, right), 3 * kSecond));
  // One light of twenty is neither a quarter of them nor a tenth of the light.
  Levels one(20, 0.0);
  one[7] = 1;
  CHECK_FALSE(too_many(in_turn(10, 0.5, one, Levels(20, 0.0)), 3 * kSecond));
  CHECK(too_many(in_turn(10, 0.5, one, Levels(20, 0.0)), 3 * kSecond, {.strobe_area = 0.05}));
}

TEST_CASE("single lights one after another are harmless at any rate, on the smallest stage", "[limits]") {
  for (const std::size_t lights : {std::size_t(1), std::size_t(2), std::size_t(3), std::size_t(180)}) {
    for (const double exposure_ms : {0.5, 5.0, 20.0, 200.0}) {
      CAPTURE(lights, exposure_ms);
      CHECK(capture::exceeded_limits(olat(lights, 0, exposure_ms), lights, {}, capture::possible_paces()).empty());
    }
  }
}

TEST_CASE("a slow fade is no flash, a quick one is one", "[limits]") {
  std::vector<LightsAt> fade;
  for (int i = 0; i <= 100; ++i) fade.emplace_back(i * 10 * kMillisecond, Levels(4, i / 100.0));
  CHECK_FALSE(too_many(fade, 3 * kSecond));
  FlashMeter meter(1, {});
  const capture::LitLight on[] = {{0, {1, 1, 1}}};
  meter.show(0, on);
  meter.show(2 * kSecond, {});
  CHECK(meter.worst().in_a_second == 1);
}

TEST_CASE("what the meter foretells is what an eye sees, for lights at random", "[limits]") {
  std::mt19937_64 random(3);
  const auto draw = [&](double least, double most) {
    return std::uniform_real_distribution<double>(least, most)(random);
  };
  int found = 0, none = 0;
  for (int i = 0; i < 60; ++i) {
    CAPTURE(i);
    const std::size_t lights = 1 + random() % 6;
    const double mean_ms = draw(4, 150), brightest = draw(0.1, 1);
    const LightLimits limits{
        .strobe_from_hz = 1 + double(random() % 4), .strobe_share = draw(0.05, 0.4), .strobe_area = draw(0.1, 1)};
    std::vector<LightsAt> changes;
    for (Nanoseconds t = 0; t < 2 * kSecond; t += Nanoseconds(draw(0.2, 2) * mean_ms * 1e6) + 1) {
      Colours levels(lights);
      for (test::Colour& level : levels) {
        if (random() % 3 == 0) continue;
        level.fill(draw(0, brightest));
        // White, one colour, or any.
        if (i % 3 == 1) level[random() % 3] = level[random() % 3] = 0;
        if (i % 3 == 2) level = {draw(0, brightest), draw(0, brightest) * draw(0, 1), draw(0, brightest) * draw(0, 1)};
      }
      changes.emplace_back(t, levels);
    }
    const test::SlowEye eye(limits.strobe_to_hz, limits.strobe_share);
    const auto expected = eye.too_many(changes, 2 * kSecond, std::size_t(limits.strobe_from_hz), limits.strobe_area);
    const auto time = too_many(changes, 2 * kSecond, limits);
    REQUIRE(time.has_value() == expected.has_value());
    if (expected) CHECK(std::abs(double(*time - *expected)) < 0.5e6);
    (expected ? found : none) += 1;
  }
  CHECK(found > 10);
  CHECK(none > 10);
}

TEST_CASE("lights go on and off when a pass says", "[limits]") {
  capture::Sequence sequence = olat(2, 0, 20);  // three dark, full-on of 20 ms, two lights
  sequence.steps.erase(sequence.steps.begin(), sequence.steps.begin() + 2);
  const Nanoseconds step = sequence.settle + 20 * kMillisecond;
  CHECK(capture::light_times(sequence, {}) == std::vector<Nanoseconds>{0, step, 2 * step, 3 * step, 4 * step});
  const Nanoseconds slow = step + 5 * kMillisecond;
  CHECK(capture::light_times(sequence, {.overhead = 5 * kMillisecond}) ==
        std::vector<Nanoseconds>{0, slow, 2 * slow, 3 * slow, 4 * slow});
  // Cameras that are not ready before keep the lights on.
  CHECK(capture::light_times(sequence, {.period = 50 * kMillisecond}) ==
        std::vector<Nanoseconds>{0, step, step + 50 * kMillisecond, step + 100 * kMillisecond,
                                 step + 150 * kMillisecond});
}

TEST_CASE("a pass is refused where its tracking frames flash too often, with what to change", "[limits]") {
  const std::span<const capture::Pace> fast(&kFast, 1);
  CHECK(capture::exceeded_limits(olat(180, 10, 20), 180, {}, fast).empty());
  const std::vector<std::string> lines = capture::exceeded_limits(olat(180, 2, 20), 180, {}, capture::possible_paces());
  REQUIRE(lines.size() == 1);
  CHECK_THAT(lines[0], Catch::Contains("the stage would flash ") &&
                           Catch::Contains("(tracking) on, which can set off seizures: at most 3 flashes"));
  // Real devices may be a little slower than the fastest, and their tracking frames so much longer.
  CHECK_FALSE(capture::exceeded_limits(olat(180, 10, 20), 180, {}, capture::possible_paces()).empty());
  CHECK(capture::exceeded_limits(olat(180, 18, 20), 180, {}, capture::possible_paces()).empty());
  CHECK(capture::exceeded_limits(olat(180, 10, 20), 180, {.strobe_share = 1}, capture::possible_paces()).empty());
  // Half of the lights against the other half, at 20 Hz.
  capture::Sequence halves;
  for (int i = 0; i < 40; ++i) {
    std::vector<capture::LightLevel> lit;
    for (int l = i % 2; l < 12; l += 2) lit.push_back({l, 1, 1, 1});
    halves.steps.push_back({.step_index = i,
                            .kind = db::StepKind::kPattern,
                            .exposure_ns = 23 * kMillisecond,
                            .pattern = capture::pattern_of(lit)});
  }
  for (const capture::Timing timing : capture::kTimings) {
    halves.timing = timing;
    CHECK_THAT(capture::exceeded_limits(halves, 12, {}, fast).at(0),
               Catch::Contains("flash more than 3 times within a second"));
  }
}

TEST_CASE("a pass is refused where a light is on for too long", "[limits]") {
  const std::span<const capture::Pace> fast(&kFast, 1);
  capture::Sequence sequence;
  for (int i = 0; i < 10; ++i)
    sequence.steps.push_back({.step_index = i, .kind = db::StepKind::kFullOn, .exposure_ns = kSecond});
  CHECK(capture::exceeded_limits(sequence, 3, {}, fast).empty());
  CHECK(capture::exceeded_limits(sequence, 3, {.on_time_s = 11}, fast).empty());
  CHECK_THAT(capture::exceeded_limits(sequence, 3, {.on_time_s = 9}, fast).at(0),
             Catch::Contains("light 0 would be on for longer than 9 s without a break, in step 8 (full_on)"));
  CHECK(capture::exceeded_limits(sequence, 3, {.duty = 0.5, .duty_window_s = 20}, fast).empty());
  CHECK_THAT(capture::exceeded_limits(sequence, 3, {.duty = 0.5, .duty_window_s = 8}, fast).at(0),
             Catch::Contains("for more than 50 % of the time, in step 7 (full_on)"));
  // OLAT gives every light its rest.
  CHECK(
      capture::exceeded_limits(olat(60, 10, 20), 60, {.duty = 0.1, .duty_window_s = 1, .on_time_s = 1}, fast).empty());
}
