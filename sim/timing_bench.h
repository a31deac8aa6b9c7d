// The trade of capture: how fast each timing mode goes on the same devices, and how often it must take frames again to stay right.
#pragma once

#include <vector>

#include "capture/session.h"
#include "sim/rig.h"

namespace lightstage::sim {

struct TimingBenchOptions {
  int lights = 100;
  int cameras = 2;
  core::Nanoseconds exposure = 8 * core::kMillisecond;
  core::Nanoseconds settle = 2 * core::kMillisecond;
  // A USB controller, and cameras of 60 pictures a second on a shared bus that stamp frames on arrival.
  DeviceTimes times{.command = core::kMillisecond,
                    .transfer = 20 * core::kMillisecond,
                    .transfer_jitter = 2 * core::kMillisecond,
                    .shortest_period = core::kSecond / 60,
                    .stamped_on_arrival = true};
  double drop_probability = 0;  // of any frame
  std::uint64_t seed = 1;
};

struct TimingRow {
  capture::Timing timing = capture::Timing::kLockstep;
  capture::SessionReport report;
  double steps_per_s = 0;    // without the preparation
  std::size_t wrong = 0;     // frames kept whose light was not their step's alone
  std::string problem;       // why the mode gave up; empty: it did not
  bool lights_left = false;  // any light on after the pass
};

// A dry run (capture/session.h) of every light once, in each mode, on small simulated cameras and in virtual time: what is
// measured is the devices' time, not this machine's. A kept frame is wrong when the mean level of any light during its
// exposure is off its step's by more than one part in a hundred (LEDs rise in 0.3 ms).
std::vector<TimingRow> bench_timing(const TimingBenchOptions& options);

}  // namespace lightstage::sim
