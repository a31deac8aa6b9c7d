// What an eye sees of changing light, reckoned step by step: the slow reference of capture::FlashMeter, from its description alone.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <optional>
#include <vector>

#include "core/clock.h"

namespace lightstage::test {

struct LightsAt {
  core::Nanoseconds time = 0;
  std::vector<double> levels;  // of every light
};

class SlowEye {
 public:
  SlowEye(double band_end_hz, double share) : tau_s_(1 / (4 * band_end_hz * std::atanh(0.1))), share_(share) {}

  // When flashes began of a signal that has value(i) from changes[i].time on, until `end`.
  template <class Value>
  std::vector<core::Nanoseconds> flashes(const std::vector<LightsAt>& changes, core::Nanoseconds end,
                                         const Value& value, core::Nanoseconds dt = core::kMillisecond / 20) const {
    std::vector<core::Nanoseconds> begun;
    const double keep = std::exp(-double(dt) / 1e9 / tau_s_);
    double seen = 0, lowest = 0, highest = 0;
    bool risen = false;
    std::size_t at = 0;
    for (core::Nanoseconds t = 0; t < end; t += dt) {
      while (at < changes.size() && changes[at].time <= t) ++at;
      const double level = at == 0 ? 0 : value(changes[at - 1]);
      seen = level + (seen - level) * keep;
      if (risen) {
        highest = std::max(highest, seen);
        if (seen > highest - share_) continue;
        risen = false;
        lowest = seen;
      } else {
        lowest = std::min(lowest, seen);
        if (seen < lowest + share_) continue;
        risen = true;
        highest = seen;
        begun.push_back(t + dt);
      }
    }
    return begun;
  }

  // When first too many had begun in a second: of all lights together, or of each of `area` of them. Nothing if never.
  std::optional<core::Nanoseconds> too_many(const std::vector<LightsAt>& changes, core::Nanoseconds end,
                                            std::size_t most, double area) const {
    const std::size_t lights = changes.empty() ? 0 : changes.front().levels.size();
    std::vector<std::vector<core::Nanoseconds>> of_light;
    for (std::size_t i = 0; i < lights; ++i) {
      of_light.push_back(flashes(changes, end, [&](const LightsAt& c) { return c.levels[i]; }));
    }
    const std::vector<core::Nanoseconds> of_all = flashes(changes, end, [&](const LightsAt& c) {
      double sum = 0;
      for (const double level : c.levels) sum += level;
      return sum / double(lights);
    });
    const auto exceeds_at = [&](const std::vector<core::Nanoseconds>& begun, core::Nanoseconds t) {
      return std::size_t(std::count_if(begun.begin(), begun.end(),
                                       [&](core::Nanoseconds b) { return b <= t && b > t - core::kSecond; })) > most;
    };
    std::vector<core::Nanoseconds> moments = of_all;
    for (const auto& begun : of_light) moments.insert(moments.end(), begun.begin(), begun.end());
    std::sort(moments.begin(), moments.end());
    for (const core::Nanoseconds t : moments) {
      std::size_t strobing = 0;
      for (const auto& begun : of_light) strobing += exceeds_at(begun, t) ? 1 : 0;
      if (exceeds_at(of_all, t) || (strobing > 0 && double(strobing) >= area * double(lights))) return t;
    }
    return std::nullopt;
  }

 private:
  double tau_s_, share_;
};

}  // namespace lightstage::test
