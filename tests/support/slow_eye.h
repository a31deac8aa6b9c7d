// What an eye sees of changing light, reckoned step by step: the slow reference of capture::FlashMeter, from its description alone.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <optional>
#include <utility>
#include <vector>

#include "core/clock.h"

namespace lightstage::test {

using Colour = std::array<double, 3>;

struct LightsAt {
  core::Nanoseconds time = 0;
  std::vector<Colour> levels;  // of every light

  LightsAt() = default;
  LightsAt(core::Nanoseconds at, std::vector<Colour> colours) : time(at), levels(std::move(colours)) {}
  // White ones.
  LightsAt(core::Nanoseconds at, const std::vector<double>& white) : time(at) {
    for (const double level : white) levels.push_back({level, level, level});
  }
};

class SlowEye {
 public:
  SlowEye(double band_end_hz, double share)
      : tau_s_(1 / (4 * band_end_hz * std::atanh(0.1))), gap_ns_(1e9 / band_end_hz), share_(share) {}

  // When flashes of this share began of a signal that has value(i) from changes[i].time on, until `end`.
  template <class Value>
  std::vector<core::Nanoseconds> flashes(const std::vector<LightsAt>& changes, core::Nanoseconds end, double share,
                                         const Value& value, core::Nanoseconds dt = core::kMillisecond / 20) const {
    std::vector<core::Nanoseconds> begun;
    const double keep = std::exp(-double(dt) / 1e9 / tau_s_);
    double seen = 0, lowest = 0, highest = 0, level = 0;
    bool risen = false;
    std::size_t at = 0;
    for (core::Nanoseconds t = 0; t < end; t += dt) {
      for (; at < changes.size() && changes[at].time <= t; ++at) level = value(changes[at]);
      seen = level + (seen - level) * keep;
      if (risen) {
        highest = std::max(highest, seen);
        if (seen > highest - share) continue;
        risen = false;
        lowest = seen;
      } else {
        lowest = std::min(lowest, seen);
        if (seen < lowest + share) continue;
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
    // Of every way of looking at a light's colours: its flashes, and how many may be.
    struct Look {
      std::vector<core::Nanoseconds> begun;
      std::size_t most;
      double gap;  // of less than this between two, the later takes the place of the earlier
      bool exceeds_at(core::Nanoseconds t) const {
        std::vector<core::Nanoseconds> counted;
        for (const core::Nanoseconds b : begun) {
          if (b > t) break;
          if (!counted.empty() && double(b - counted.back()) < gap) counted.pop_back();
          counted.push_back(b);
        }
        return std::size_t(std::count_if(counted.begin(), counted.end(),
                                         [&](core::Nanoseconds b) { return b > t - core::kSecond; })) > most;
      }
    };
    const auto looks = [&](const auto& of_lights) {
      std::vector<Look> all;
      const auto look = [&](double share, const auto& value) {
        const auto of_all = [&](const LightsAt& c) { return of_lights(c, value); };
        all.push_back(Look{flashes(changes, end, share, of_all), most, gap_ns_});
        all.push_back(Look{flashes(changes, end, share / 2, of_all), 3 * most, gap_ns_});
      };
      for (std::size_t colour = 0; colour < 3; ++colour) look(share_, [colour](const Colour& c) { return c[colour]; });
      look(share_, [](const Colour& c) { return (c[0] + c[1] + c[2]) / 3; });
      look(share_, [](const Colour& c) { return *std::max_element(c.begin(), c.end()); });
      look(share_ * 20 / 320 / 0.1, [](const Colour& c) {
        const double sum = c[0] + c[1] + c[2];
        return sum > 0 && c[0] / sum >= 0.8 ? c[0] - c[1] - c[2] : 0.0;
      });
      return all;
    };
    std::vector<std::vector<Look>> of_light;
    for (std::size_t i = 0; i < lights; ++i) {
      of_light.push_back(looks([&](const LightsAt& c, const auto& value) { return value(c.levels[i]); }));
    }
    const std::vector<Look> of_all = looks([&](const LightsAt& c, const auto& value) {
      double sum = 0;
      for (const Colour& level : c.levels) sum += value(level);
      return sum / double(lights);
    });
    std::vector<core::Nanoseconds> moments;
    const auto add = [&](const std::vector<Look>& some) {
      for (const Look& look : some) moments.insert(moments.end(), look.begun.begin(), look.begun.end());
    };
    add(of_all);
    for (const auto& some : of_light) add(some);
    std::sort(moments.begin(), moments.end());
    for (const core::Nanoseconds t : moments) {
      const auto exceeds = [&](const std::vector<Look>& some) {
        return std::any_of(some.begin(), some.end(), [&](const Look& look) { return look.exceeds_at(t); });
      };
      const auto strobing = std::count_if(of_light.begin(), of_light.end(), exceeds);
      if (exceeds(of_all) || (strobing > 0 && double(strobing) >= area * double(lights))) return t;
    }
    return std::nullopt;
  }

 private:
  double tau_s_, gap_ns_, share_;
};

}  // namespace lightstage::test
