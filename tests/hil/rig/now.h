#pragma once

#include <time.h>

#include "hil/rig/scene.h"

namespace lightstage::hil {

// The rig's clock, which is also that of the program under test: CLOCK_MONOTONIC of one machine.
inline Nanoseconds now() {
  timespec t{};
  clock_gettime(CLOCK_MONOTONIC, &t);
  return Nanoseconds{t.tv_sec} * 1'000'000'000 + t.tv_nsec;
}

}  // namespace lightstage::hil
