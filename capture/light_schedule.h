// When a sequence's lights go on and off, before they do; and what of it the stage's limits do not allow.
#pragma once

#include <span>
#include <string>
#include <vector>

#include "capture/light_limits.h"
#include "capture/sequence.h"
#include "core/clock.h"

namespace lightstage::capture {

// How fast devices are. What is not known must be tried: slow ones make flashes longer, fast ones more frequent.
struct Pace {
  core::Nanoseconds overhead =
      0;  // from the end of an exposure until the next lights are on (lockstep: transfer and command)
  core::Nanoseconds period = 0;  // shortest between the starts of exposures
};

// What devices may be like of which nothing is known.
std::vector<Pace> possible_paces();

// When each step's lights go on, in the order of steps, and at the end when the last one's go off; the first at 0. As session/ lights them,
// without retakes.
std::vector<core::Nanoseconds> light_times(const Sequence& sequence, const Pace& pace);

// One line each for what exceeds the limits at one of the paces: what, how much, and what to do. Flashing first. O(paces * steps * lights).
std::vector<std::string> exceeded_limits(const Sequence& sequence, std::size_t light_count, const LightLimits& limits,
                                         std::span<const Pace> paces);

}  // namespace lightstage::capture
