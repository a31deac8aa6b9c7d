#include "capture/light_limits.h"

#include <algorithm>
#include <cmath>

namespace lightstage::capture {

namespace {
constexpr core::Nanoseconds kWindow = core::kSecond;
// What an eye sees of less than this is darkness; keeps numbers that decay for ever out of the way.
constexpr double kDark = 1e-9;
}  // namespace

FlashMeter::FlashMeter(std::size_t lights, const LightLimits& limits)
    : limits_(limits),
      most_(std::max<std::size_t>(1, std::size_t(limits.strobe_from_hz))),
      // A square wave of frequency f swings by tanh(1 / (4 f tau)) once it has settled.
      eye_ns_(double(core::kSecond) / (4 * limits.strobe_to_hz * std::atanh(0.1))),
      lights_(lights) {}

// Between changes the signal comes ever nearer to its level.
std::optional<core::Nanoseconds> FlashMeter::next_flash(const Signal& signal) const {
  const double lowest = std::min(signal.extreme, signal.seen), wanted = lowest + limits_.strobe_share;
  if (signal.high || signal.level <= wanted) return std::nullopt;
  if (signal.seen >= wanted) return time_;
  const double wait = eye_ns_ * std::log((signal.level - signal.seen) / (signal.level - wanted));
  return time_ + core::Nanoseconds(std::ceil(wait));
}

void FlashMeter::advance(Signal& signal, core::Nanoseconds to, double decay) const {
  const std::optional<core::Nanoseconds> flash = next_flash(signal);
  double seen = signal.level + (signal.seen - signal.level) * decay;
  if (seen < kDark) seen = 0;
  if (signal.high) {
    signal.extreme = std::max({signal.extreme, signal.seen, seen});
    if (seen <= signal.extreme - limits_.strobe_share) {
      signal.high = false;
      signal.extreme = seen;
    }
  } else if (flash && *flash <= to) {
    signal.high = true;
    signal.extreme = std::max(signal.seen, seen);
    signal.flashes.push_back(*flash);
    if (signal.flashes.size() > most_ + 1) signal.flashes.erase(signal.flashes.begin());
  } else {
    signal.extreme = std::min({signal.extreme, signal.seen, seen});
  }
  signal.seen = seen;
}

void FlashMeter::show(core::Nanoseconds now, std::span<const std::pair<std::size_t, double>> lit) {
  if (now > time_) {
    const double decay = std::exp(-double(now - time_) / eye_ns_);
    const std::size_t before = all_.flashes.empty() ? 0 : std::size_t(all_.flashes.back());
    const double lowest = std::min(all_.extreme, all_.seen);
    advance(all_, now, decay);
    if (!all_.flashes.empty() && std::size_t(all_.flashes.back()) != before) {
      const auto recent = std::count_if(all_.flashes.begin(), all_.flashes.end(),
                                        [&](core::Nanoseconds t) { return all_.flashes.back() - t < kWindow; });
      most_in_a_second_ = std::max(most_in_a_second_, int(recent));
      largest_rise_ = std::max(largest_rise_, all_.seen - lowest);
    }
    for (Signal& light : lights_) {
      if (light.level > 0 || light.seen > 0) advance(light, now, decay);
    }
    time_ = now;
  }
  all_.level = 0;
  for (Signal& light : lights_) light.level = 0;
  for (const auto& [light, level] : lit) {
    lights_[light].level = level;
    all_.level += level / double(lights_.size());
  }
}

std::optional<core::Nanoseconds> FlashMeter::too_many_until(const Signal& signal, core::Nanoseconds flash) const {
  // The flash that has most_ between itself and this one's end, this one counted.
  if (signal.flashes.size() < most_) return std::nullopt;
  const core::Nanoseconds oldest = signal.flashes[signal.flashes.size() - most_];
  if (flash - oldest >= kWindow) return std::nullopt;
  return oldest + kWindow;
}

std::optional<core::Nanoseconds> FlashMeter::too_many() const {
  if (limits_.strobe_share >= 1) return std::nullopt;
  std::optional<core::Nanoseconds> first;
  if (const auto flash = next_flash(all_); flash && too_many_until(all_, *flash)) first = flash;
  // Lights that flash too often: from when until when; and when another flash adds to them.
  std::vector<std::pair<core::Nanoseconds, core::Nanoseconds>> strobing;
  std::vector<core::Nanoseconds> flashes;
  for (const Signal& light : lights_) {
    if (light.flashes.size() < most_) continue;
    // Where its last flash was one too many, that holds until the first of them is a second ago.
    const std::size_t n = light.flashes.size();
    core::Nanoseconds begin = time_, end = time_;
    if (n > most_ && light.flashes[n - 1] - light.flashes[n - 1 - most_] < kWindow) {
      end = light.flashes[n - 1 - most_] + kWindow;
    }
    if (const auto flash = next_flash(light)) {
      if (const auto until = too_many_until(light, *flash)) {
        flashes.push_back(*flash);
        if (*flash > end) {
          if (end > begin) strobing.emplace_back(begin, end);
          begin = *flash;
        }
        end = *until;
      }
    }
    if (end > begin) strobing.emplace_back(begin, end);
  }
  const double enough = limits_.strobe_area * double(lights_.size());
  if (double(strobing.size()) < enough) return first;
  std::sort(flashes.begin(), flashes.end());
  for (const core::Nanoseconds flash : flashes) {
    if (first && *first <= flash) break;
    const auto at_once = std::count_if(strobing.begin(), strobing.end(),
                                       [&](const auto& s) { return s.first <= flash && flash < s.second; });
    if (double(at_once) >= enough) return flash;
  }
  return first;
}

}  // namespace lightstage::capture
