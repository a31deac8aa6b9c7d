#include "capture/gpio/strobe.h"

#include <algorithm>

#include "capture/gpio/reopen.h"
#include "core/error.h"

namespace lightstage::capture {

namespace {
// The kernel queues 16 edges a line.
constexpr int kMostEdgesQueued = 1000;
}  // namespace

GpioStrobe::GpioStrobe(const StrobeSpec& spec, std::unique_ptr<GpioChips> chips, core::Clock& clock)
    : request_{spec.chip, {spec.line}, spec.active_low}, chips_(std::move(chips)), clock_(clock) {
  open();
}

void GpioStrobe::open() {
  const core::Nanoseconds now = clock_.now();
  edges_ = chips_->open_edges(request_);
  opened_ = now;
}

void GpioStrobe::open_if_needed() {
  if (edges_ == nullptr) reopen(clock_, [this] { open(); });
}

void GpioStrobe::clear() {
  open_if_needed();
  try {
    for (int edges = 0; edges_->next_edge(0); ++edges) {
      if (edges == kMostEdgesQueued) {
        throw core::DeviceError(describe(request_) +
                                ": pulses without end: is the strobe wired, or the line floating?");
      }
    }
  } catch (const core::DeviceError&) {
    edges_.reset();
    throw;
  }
}

std::optional<core::Nanoseconds> GpioStrobe::wait_exposure(core::Nanoseconds deadline) {
  open_if_needed();
  try {
    const std::optional<core::Nanoseconds> edge = next_edge(deadline);
    if (edge) {
      check_time(*edge);
    } else {
      edges_->check();
    }
    return edge;
  } catch (const core::DeviceError&) {
    edges_.reset();
    throw;
  }
}

std::optional<core::Nanoseconds> GpioStrobe::next_edge(core::Nanoseconds deadline) {
  while (true) {
    const core::Nanoseconds left = std::max<core::Nanoseconds>(0, deadline - clock_.now());
    if (const auto edge = edges_->next_edge(left)) return edge;
    if (clock_.now() >= deadline) return {};
  }
}

void GpioStrobe::check_time(core::Nanoseconds edge) const {
  if (edge >= opened_ && edge <= clock_.now()) return;
  throw core::DeviceError(describe(request_) +
                          ": its edges are not stamped by the session's clock, CLOCK_MONOTONIC: Linux 5.7 or later is "
                          "needed for a strobe");
}

std::unique_ptr<Strobe> open_gpio_strobe(const StrobeSpec& spec, core::Clock& clock) {
  return std::make_unique<GpioStrobe>(spec, system_gpio_chips(), clock);
}

}  // namespace lightstage::capture
