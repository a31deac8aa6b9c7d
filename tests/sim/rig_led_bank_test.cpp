#include <catch2/catch.hpp>
#include <map>
#include <random>

#include "sim/devices/led_bank.h"

using namespace lightstage;
using capture::LightLevel;
using core::Nanoseconds;
using sim::LedBank;

namespace {

constexpr Nanoseconds kMs = core::kMillisecond;

// The plain definition, followed change by change at one moment.
struct Change {
  Nanoseconds time;
  double level;
};
double level_at(const std::vector<Change>& changes, Nanoseconds rise_time, double t) {
  double level = 0, target = 0, since = 0;
  const auto follow = [&](double until) {
    if (target <= level || rise_time == 0) return target;
    return target - (target - level) * std::exp(-(until - since) / static_cast<double>(rise_time));
  };
  for (const Change& change : changes) {
    if (static_cast<double>(change.time) > t) break;
    level = follow(static_cast<double>(change.time));
    since = static_cast<double>(change.time);
    target = change.level;
    level = std::min(level, target);
  }
  return follow(t);
}

// Midpoint rule between the changes, which is where the level is smooth.
double numeric_mean(const std::vector<Change>& changes, Nanoseconds rise_time, Nanoseconds begin, Nanoseconds end) {
  std::vector<double> knots{static_cast<double>(begin)};
  for (const Change& change : changes) {
    if (change.time > begin && change.time < end) knots.push_back(static_cast<double>(change.time));
  }
  knots.push_back(static_cast<double>(end));
  double integral = 0;
  for (std::size_t k = 0; k + 1 < knots.size(); ++k) {
    constexpr int kPieces = 200000;
    const double step = (knots[k + 1] - knots[k]) / kPieces;
    double sum = 0;
    for (int i = 0; i < kPieces; ++i) sum += level_at(changes, rise_time, knots[k] + (i + 0.5) * step);
    integral += sum * step;
  }
  return integral / static_cast<double>(end - begin);
}

double mean_of(const LedBank& bank, Nanoseconds begin, Nanoseconds end, int light = 0) {
  for (const LightLevel& l : bank.mean_levels(begin, end)) {
    if (l.light_index == light) return static_cast<double>(l.r);
  }
  return 0;
}

}  // namespace

TEST_CASE("the mean level over an exposure agrees with numeric integration at every ratio of exposure to rise time") {
  const Nanoseconds rise_time = GENERATE(0, 1000, 300'000, 3 * kMs, 1000 * kMs);
  const Nanoseconds exposure = GENERATE(1000, 100'000, 20 * kMs, 1000 * kMs);
  const Nanoseconds begin = GENERATE(0, 50'000, 2 * kMs);
  LedBank bank(1, rise_time);
  bank.show(0, std::vector<LightLevel>{{0, 0.8f, 1, 1}});
  const double expected = numeric_mean({{0, static_cast<double>(0.8f)}}, rise_time, begin, begin + exposure);
  CAPTURE(rise_time, exposure, begin);
  // The midpoint rule itself is off by the square of the step over the rise time.
  CHECK(mean_of(bank, begin, begin + exposure) == Approx(expected).epsilon(3e-6));
}

TEST_CASE("changes within the exposure are followed exactly") {
  std::mt19937_64 random(3);
  for (int round = 0; round < 20; ++round) {
    const Nanoseconds rise_time = round % 5 == 0 ? 0 : static_cast<Nanoseconds>(1 + random() % 5'000'000);
    LedBank bank(2, rise_time);
    std::vector<Change> changes;
    Nanoseconds time = 0;
    for (int i = 0; i < 6; ++i) {
      const float level = random() % 3 == 0 ? 0 : static_cast<float>(random() % 1000) / 999;
      bank.show(time, std::vector<LightLevel>{{0, level, 0, 0}});
      changes.push_back({time, static_cast<double>(level)});
      time += static_cast<Nanoseconds>(random() % 3'000'000);
    }
    const auto begin = static_cast<Nanoseconds>(random() % 5'000'000);
    const auto end = begin + static_cast<Nanoseconds>(1 + random() % 9'000'000);
    CAPTURE(round, rise_time, begin, end);
    CHECK(mean_of(bank, begin, end) == Approx(numeric_mean(changes, rise_time, begin, end)).epsilon(1e-5).margin(1e-7));
  }
}

TEST_CASE("exposures so short that nothing rises see the level of that moment") {
  LedBank bank(1, 1000 * core::kSecond);
  bank.show(0, std::vector<LightLevel>{{0}});
  // level(t) = -expm1(-t / rise): over [0, d] its mean is d / (2 rise).
  CHECK(mean_of(bank, 0, 2) == Approx(1e-12).epsilon(1e-6));
  CHECK(mean_of(bank, 0, 2'000'000) == Approx(1e-6).epsilon(1e-6));
  CHECK(mean_of(bank, 1'000'000, 1'000'002) == Approx(1e-6).epsilon(1e-5));
}

TEST_CASE("after a long time the level is the one asked for, per channel") {
  LedBank bank(3, 300'000);
  bank.show(5 * kMs, std::vector<LightLevel>{{1, 0.25f, 0.5f, 1}});
  CHECK(bank.mean_levels(1000 * kMs, 1020 * kMs) == std::vector<LightLevel>{{1, 0.25f, 0.5f, 1}});
  CHECK(bank.mean_levels(0, 5 * kMs).empty());
  CHECK(bank.any_on());
}

TEST_CASE("LEDs go off at once and lights not shown are dark") {
  LedBank bank(3, 300'000);
  bank.show(0, std::vector<LightLevel>{{0}, {2}});
  bank.show(10 * kMs, std::vector<LightLevel>{{1}});
  const std::vector<LightLevel> means = bank.mean_levels(10 * kMs, 30 * kMs);
  REQUIRE(means.size() == 1);
  CHECK(means[0].light_index == 1);
  bank.show(30 * kMs, {});
  CHECK_FALSE(bank.any_on());
  CHECK(bank.mean_levels(30 * kMs, 40 * kMs).empty());
  CHECK(bank.mean_levels(9 * kMs, 11 * kMs).size() == 3);
}

TEST_CASE("forgetting the past changes nothing after it") {
  LedBank bank(1, 2 * kMs), whole(1, 2 * kMs);
  for (const auto& [time, level] :
       std::map<Nanoseconds, float>{{0, 1.0f}, {kMs, 0.2f}, {2 * kMs, 0.9f}, {5 * kMs, 1.0f}}) {
    bank.show(time, std::vector<LightLevel>{{0, level, level, level}});
    whole.show(time, std::vector<LightLevel>{{0, level, level, level}});
  }
  for (const Nanoseconds t : {Nanoseconds(0), kMs / 2, 2 * kMs, 3 * kMs, 5 * kMs, 9 * kMs}) {
    bank.forget_before(t);
    for (const Nanoseconds length : {Nanoseconds(1), kMs, 10 * kMs}) {
      CHECK(bank.mean_levels(t, t + length) == whole.mean_levels(t, t + length));
    }
  }
}
