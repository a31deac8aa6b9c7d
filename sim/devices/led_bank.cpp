#include "sim/devices/led_bank.h"

#include <algorithm>
#include <limits>

namespace lightstage::sim {

LedBank::LedBank(std::size_t light_count, core::Nanoseconds rise_time)
    : light_count_(light_count), rise_time_(rise_time) {}

double LedBank::level_after(double start, double target, core::Nanoseconds elapsed) const {
  if (target <= start || rise_time_ <= 0) return target;
  return target - (target - start) * std::exp(-static_cast<double>(elapsed) / static_cast<double>(rise_time_));
}

// Of the level from `from` to `to` after the change. With x = (to - from) / rise time the integral of the
// missing part is (target - start) exp(-from / rise time) * rise time * (1 - exp(-x)). Where the exposure is
// far shorter than the rise, target minus missing part cancels; so the part is taken off as its value at
// `from` plus what is gained since: level(from) * length + (target - level(from)) * (length - rise time * (1
// - exp(-x))).
double LedBank::integral_ns(double start, double target, core::Nanoseconds from, core::Nanoseconds to) const {
  const auto length = static_cast<double>(to - from);
  const double at_from = level_after(start, target, from);
  if (target <= start || rise_time_ <= 0) return target * length;
  const auto rise = static_cast<double>(rise_time_);
  const double x = length / rise;
  // 1 - (1 - exp(-x)) / x loses all digits for small x; its series does not.
  const double gained = x < 1e-3 ? x / 2 * (1 - x / 3 * (1 - x / 4)) : 1 + std::expm1(-x) / x;
  return length * (at_from + (target - at_from) * gained);
}

void LedBank::show(core::Nanoseconds t, std::span<const capture::LightLevel> levels) {
  Change change{t, std::vector<Led>(light_count_)};
  if (!changes_.empty()) {
    const Change& last = changes_.back();
    for (std::size_t i = 0; i < light_count_; ++i) {
      for (std::size_t c = 0; c < 3; ++c) {
        change.leds[i].start[c] = level_after(last.leds[i].start[c], last.leds[i].target[c], t - last.time);
      }
    }
  }
  for (const capture::LightLevel& l : levels) {
    change.leds[static_cast<std::size_t>(l.light_index)].target = {l.r, l.g, l.b};
  }
  changes_.push_back(std::move(change));
}

bool LedBank::any_on() const {
  if (changes_.empty()) return false;
  const auto lit = [](const Led& led) { return led.target != Rgb{}; };
  return std::any_of(changes_.back().leds.begin(), changes_.back().leds.end(), lit);
}

std::vector<capture::LightLevel> LedBank::mean_levels(core::Nanoseconds begin, core::Nanoseconds end) const {
  std::vector<Rgb> integrals(light_count_);
  for (std::size_t k = 0; k < changes_.size(); ++k) {
    const Change& change = changes_[k];
    const core::Nanoseconds next =
        k + 1 < changes_.size() ? changes_[k + 1].time : std::numeric_limits<core::Nanoseconds>::max();
    const core::Nanoseconds from = std::max(begin, change.time), to = std::min(end, next);
    if (from >= to) continue;
    for (std::size_t i = 0; i < light_count_; ++i) {
      for (std::size_t c = 0; c < 3; ++c) {
        integrals[i][c] +=
            integral_ns(change.leds[i].start[c], change.leds[i].target[c], from - change.time, to - change.time);
      }
    }
  }
  std::vector<capture::LightLevel> means;
  const auto length = static_cast<double>(end - begin);
  for (std::size_t i = 0; i < light_count_; ++i) {
    if (integrals[i] == Rgb{}) continue;
    const auto mean = [&](std::size_t c) { return static_cast<float>(integrals[i][c] / length); };
    means.push_back({static_cast<int>(i), mean(0), mean(1), mean(2)});
  }
  return means;
}

void LedBank::forget_before(core::Nanoseconds t) {
  // The last change at or before t still decides the levels after it.
  const auto later = std::find_if(changes_.begin(), changes_.end(), [t](const Change& c) { return c.time > t; });
  if (later - changes_.begin() > 1) changes_.erase(changes_.begin(), later - 1);
}

}  // namespace lightstage::sim
