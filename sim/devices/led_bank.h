// The simulated LEDs: what each gives, at any time, averaged over an exposure.
#pragma once

#include <array>
#include <cstddef>
#include <span>
#include <vector>

#include "capture/sequence.h"
#include "core/clock.h"

namespace lightstage::sim {

// A rising LED approaches its level exponentially (its driver starts softly): after the rise time 63 % of the
// way is done. A falling one is at its new level at once.
class LedBank {
 public:
  LedBank(std::size_t light_count, core::Nanoseconds rise_time);

  std::size_t light_count() const { return light_count_; }

  // From time t on, exactly these lights; t must not be before the last change. Indices must be within the
  // bank.
  void show(core::Nanoseconds t, std::span<const capture::LightLevel> levels);

  // True when the last change lit anything.
  bool any_on() const;

  // Mean levels over [begin, end], begin < end, of the lights that gave any light in it, in order of index.
  // Exact: the integral is taken in closed form, over every change within. Changes before the time given to
  // forget_before count as dark.
  std::vector<capture::LightLevel> mean_levels(core::Nanoseconds begin, core::Nanoseconds end) const;

  // No exposure that begins before t will be asked for any more.
  void forget_before(core::Nanoseconds t);

 private:
  using Rgb = std::array<double, 3>;
  struct Led {
    Rgb start{}, target{};  // at the time of the change, and long after it
  };
  struct Change {
    core::Nanoseconds time = 0;
    std::vector<Led> leds;
  };
  double level_after(double start, double target, core::Nanoseconds elapsed) const;
  double integral_ns(double start, double target, core::Nanoseconds from, core::Nanoseconds to) const;

  std::size_t light_count_;
  core::Nanoseconds rise_time_;
  std::vector<Change> changes_;  // in order of time
};

}  // namespace lightstage::sim
