#pragma once

#include "core/clock.h"

namespace lightstage::hil {

// Waits until `condition` holds; false when it did not within `limit`.
template <typename Condition>
bool holds_within(core::Nanoseconds limit, const Condition& condition) {
  core::SystemClock clock;
  const core::Nanoseconds deadline = clock.now() + limit;
  while (!condition()) {
    if (clock.now() >= deadline) return false;
    clock.sleep_until(clock.now() + 10 * core::kMillisecond);
  }
  return true;
}

}  // namespace lightstage::hil
