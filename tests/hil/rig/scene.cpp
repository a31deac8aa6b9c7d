#include "hil/rig/scene.h"

#include <algorithm>

namespace lightstage::hil {

namespace {

// Longer than any exposure that the cameras can be set to.
constexpr Nanoseconds kRemembered = 5'000 * kMillisecond;

}  // namespace

void Scene::set(Nanoseconds time, std::size_t first, std::span<const Rgb> levels) {
  if (std::equal(levels.begin(), levels.end(), now().begin() + static_cast<std::ptrdiff_t>(first))) return;
  Change change{std::max(time, changes_.back().time), now()};
  std::copy(levels.begin(), levels.end(), change.levels.begin() + static_cast<std::ptrdiff_t>(first));
  changes_.push_back(change);
  // The first of two is needed as long as the second is not older than all that may be asked for.
  while (changes_.size() > 1 && changes_[1].time < change.time - kRemembered) changes_.pop_front();
  if (on_change) on_change(change.time, change.levels);
}

Levels Scene::mean(Nanoseconds start, Nanoseconds end) const {
  Levels mean{};
  for (std::size_t i = 0; i < changes_.size(); ++i) {
    const Nanoseconds until = i + 1 < changes_.size() ? std::min(end, changes_[i + 1].time) : end;
    const Nanoseconds from = std::max(start, changes_[i].time);
    if (until <= from) continue;
    const float share = static_cast<float>(until - from) / static_cast<float>(end - start);
    for (std::size_t cell = 0; cell < kCells; ++cell) {
      for (std::size_t c = 0; c < 3; ++c) mean[cell][c] += share * changes_[i].levels[cell][c];
    }
  }
  return mean;
}

}  // namespace lightstage::hil
