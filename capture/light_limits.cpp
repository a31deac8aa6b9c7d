#include "capture/light_limits.h"

#include <algorithm>
#include <cmath>

namespace lightstage::capture {

namespace {
constexpr core::Nanoseconds kWindow = core::kSecond;
// What an eye sees of less than this is darkness; keeps numbers that decay for ever out of the way.
constexpr double kDark = 1e-9;

// Views of a light's colours: red, green, blue, mean, maximum and saturated red. Signals are in this order, each for large and for small flashes.
constexpr std::size_t kViews = 6, kSizes = 2;
constexpr std::size_t kRed = 5;
constexpr double kSaturated = 0.8, kRedShare = 0.625;
constexpr double kSmallShare = 0.5;
constexpr std::size_t kSmallTimes = 3;

// Faster than the band ends, light is steady: such a flash takes the place of the one before.
bool follows_at_once(const std::vector<core::Nanoseconds>& flashes, core::Nanoseconds flash,
                     const LightLimits& limits) {
  return !flashes.empty() && double(flash - flashes.back()) * limits.strobe_to_hz < double(core::kSecond);
}

std::array<double, kViews> views(const std::array<double, 3>& rgb) {
  const auto [r, g, b] = rgb;
  const double sum = r + g + b;
  return {r, g, b, sum / 3, std::max({r, g, b}), r >= kSaturated * sum ? r - g - b : 0};
}
}  // namespace

FlashMeter::FlashMeter(std::size_t lights, const LightLimits& limits)
    : limits_(limits),
      most_(std::max<std::size_t>(1, std::size_t(limits.strobe_from_hz))),
      // A square wave of frequency f swings by tanh(1 / (4 f tau)) once it has settled.
      eye_ns_(double(core::kSecond) / (4 * limits.strobe_to_hz * std::atanh(0.1))),
      all_{std::vector<Signal>(kViews * kSizes)},
      lights_(lights, Source{std::vector<Signal>(kSizes)}) {}

FlashMeter::Rule FlashMeter::rule(std::size_t signal) const {
  const bool small = signal % kSizes != 0;
  return {limits_.strobe_share * (signal / kSizes == kRed ? kRedShare : 1) * (small ? kSmallShare : 1),
          most_ * (small ? kSmallTimes : 1)};
}

void FlashMeter::set(Source& source, std::span<const double> levels) {
  std::vector<Signal>& signals = source.signals;
  const bool white = levels[0] == levels[1] && levels[1] == levels[2];
  if (!white && signals.size() == kSizes) {
    // Until now all views have been one, but for that of red, which was dark.
    for (std::size_t i = kSizes; i < kViews * kSizes; ++i) {
      Signal same = i / kSizes == kRed ? Signal{} : signals[i % kSizes];
      signals.push_back(std::move(same));
    }
  }
  for (std::size_t i = 0; i < signals.size(); ++i) signals[i].level = levels[i / kSizes];
}

// Between changes the signal comes ever nearer to its level.
std::optional<core::Nanoseconds> FlashMeter::next_flash(const Signal& signal, const Rule& rule) const {
  const double lowest = std::min(signal.extreme, signal.seen), wanted = lowest + rule.share;
  if (signal.high || signal.level <= wanted) return std::nullopt;
  if (signal.seen >= wanted) return time_;
  const double wait = eye_ns_ * std::log((signal.level - signal.seen) / (signal.level - wanted));
  return time_ + core::Nanoseconds(std::ceil(wait));
}

void FlashMeter::advance(Signal& signal, const Rule& rule, core::Nanoseconds to, double decay) const {
  if (signal.level <= 0 && signal.seen <= 0) return;
  const std::optional<core::Nanoseconds> flash = next_flash(signal, rule);
  double seen = signal.level + (signal.seen - signal.level) * decay;
  if (seen < kDark) seen = 0;
  if (signal.high) {
    signal.extreme = std::max({signal.extreme, signal.seen, seen});
    if (seen <= signal.extreme - rule.share) {
      signal.high = false;
      signal.extreme = seen;
    }
  } else if (flash && *flash <= to) {
    signal.high = true;
    signal.extreme = std::max(signal.seen, seen);
    if (follows_at_once(signal.flashes, *flash, limits_)) signal.flashes.pop_back();
    signal.flashes.push_back(*flash);
    if (signal.flashes.size() > rule.most + 1) signal.flashes.erase(signal.flashes.begin());
  } else {
    signal.extreme = std::min({signal.extreme, signal.seen, seen});
  }
  signal.seen = seen;
}

void FlashMeter::show(core::Nanoseconds now, std::span<const LitLight> lit) {
  if (now > time_) {
    const double decay = std::exp(-double(now - time_) / eye_ns_);
    for (std::size_t i = 0; i < all_.signals.size(); ++i) {
      Signal& signal = all_.signals[i];
      const core::Nanoseconds before = signal.flashes.empty() ? -1 : signal.flashes.back();
      const double lowest = std::min(signal.extreme, signal.seen);
      advance(signal, rule(i), now, decay);
      if (signal.flashes.empty() || signal.flashes.back() == before) continue;
      const auto recent = std::count_if(signal.flashes.begin(), signal.flashes.end(),
                                        [&](core::Nanoseconds t) { return signal.flashes.back() - t < kWindow; });
      Worst& worst = worst_.at(i % kSizes);
      worst.in_a_second = std::max(worst.in_a_second, int(recent));
      worst.rise = std::max(worst.rise, signal.seen - lowest);
    }
    for (Source& light : lights_) {
      for (std::size_t i = 0; i < light.signals.size(); ++i) advance(light.signals[i], rule(i), now, decay);
    }
    time_ = now;
  }
  std::array<double, kViews> sum{};
  for (Source& light : lights_) {
    for (Signal& signal : light.signals) signal.level = 0;
  }
  for (const LitLight& light : lit) {
    const std::array<double, kViews> levels = views(light.rgb);
    set(lights_[light.light], levels);
    for (std::size_t v = 0; v < kViews; ++v) sum[v] += levels[v] / double(lights_.size());
  }
  for (std::size_t i = 0; i < all_.signals.size(); ++i) all_.signals[i].level = sum[i / kSizes];
}

std::optional<core::Nanoseconds> FlashMeter::too_many_until(const Signal& signal, const Rule& rule,
                                                            core::Nanoseconds flash) {
  // The flash that has `most` between itself and this one's end, this one counted.
  if (signal.flashes.size() < rule.most) return std::nullopt;
  const core::Nanoseconds oldest = signal.flashes[signal.flashes.size() - rule.most];
  if (flash - oldest >= kWindow) return std::nullopt;
  return oldest + kWindow;
}

std::optional<core::Nanoseconds> FlashMeter::too_many() const {
  if (limits_.strobe_share >= 1) return std::nullopt;
  std::optional<core::Nanoseconds> first;
  for (std::size_t i = 0; i < all_.signals.size(); ++i) {
    const Signal& signal = all_.signals[i];
    const auto flash = next_flash(signal, rule(i));
    if (!flash || follows_at_once(signal.flashes, *flash, limits_)) continue;
    if (too_many_until(signal, rule(i), *flash) && (!first || *flash < *first)) first = flash;
  }
  // Lights that flash too often in one view or another: from when until when; and when another flash adds to them.
  struct Strobing {
    std::size_t light = 0;
    core::Nanoseconds begin = 0, end = 0;
  };
  std::vector<Strobing> strobing;  // by light
  std::vector<core::Nanoseconds> flashes;
  for (std::size_t l = 0; l < lights_.size(); ++l) {
    for (std::size_t i = 0; i < lights_[l].signals.size(); ++i) {
      const Signal& signal = lights_[l].signals[i];
      const Rule limit = rule(i);
      if (signal.flashes.size() < limit.most) continue;
      // Where its last flash was one too many, that holds until the first of them is a second ago.
      const std::size_t n = signal.flashes.size();
      core::Nanoseconds begin = time_, end = time_;
      if (n > limit.most && signal.flashes[n - 1] - signal.flashes[n - 1 - limit.most] < kWindow) {
        end = signal.flashes[n - 1 - limit.most] + kWindow;
      }
      if (const auto flash = next_flash(signal, limit); flash && !follows_at_once(signal.flashes, *flash, limits_)) {
        if (const auto until = too_many_until(signal, limit, *flash)) {
          flashes.push_back(*flash);
          if (*flash > end) {
            if (end > begin) strobing.push_back({l, begin, end});
            begin = *flash;
          }
          end = *until;
        }
      }
      if (end > begin) strobing.push_back({l, begin, end});
    }
  }
  const double enough = limits_.strobe_area * double(lights_.size());
  if (double(strobing.size()) < enough) return first;
  std::sort(flashes.begin(), flashes.end());
  for (const core::Nanoseconds flash : flashes) {
    if (first && *first <= flash) break;
    std::size_t at_once = 0;
    std::optional<std::size_t> counted;
    for (const Strobing& s : strobing) {
      if (flash < s.begin || flash >= s.end || counted == s.light) continue;
      counted = s.light;
      ++at_once;
    }
    if (double(at_once) >= enough) return flash;
  }
  return first;
}

}  // namespace lightstage::capture
