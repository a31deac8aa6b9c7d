// The light in the emulated stage over time. What lights it is told apart to the last output, so that a picture shows which
// lights were lit while it was exposed, and in which share of that time.
#pragma once

#include <array>
#include <cstdint>
#include <deque>
#include <functional>
#include <span>

namespace lightstage::hil {

using Nanoseconds = std::int64_t;  // of CLOCK_MONOTONIC
constexpr Nanoseconds kMillisecond = 1'000'000;

// Pictures are a grid of cells; each shows one output of a controller and nothing else.
constexpr std::size_t kCellColumns = 20, kCellRows = 15, kCells = kCellColumns * kCellRows;
// The outputs of the LED controller come first, then the channels of the DMX widget.
constexpr std::size_t kLedOutputs = 150, kDmxChannels = kCells - kLedOutputs;

using Rgb = std::array<float, 3>;  // 0 to 1
using Levels = std::array<Rgb, kCells>;

class Scene {
 public:
  // Called after every change.
  std::function<void(Nanoseconds time, const Levels&)> on_change;

  // These cells, from `first` on, have these levels from `time` on. A time before the last change counts as that.
  void set(Nanoseconds time, std::size_t first, std::span<const Rgb> levels);

  const Levels& now() const { return changes_.back().levels; }
  Levels mean(Nanoseconds start, Nanoseconds end) const;

 private:
  struct Change {
    Nanoseconds time = 0;
    Levels levels{};
  };
  std::deque<Change> changes_{Change{}};  // the oldest are forgotten
};

}  // namespace lightstage::hil
