// Runs a sequence over cameras and lights into the store.
#pragma once

#include <span>
#include <string>
#include <vector>

#include "capture/devices.h"
#include "capture/sequence.h"
#include "core/clock.h"
#include "db/store.h"

namespace lightstage::capture {

struct Rig {
  LedController& lights;
  Trigger& trigger;
  std::span<Camera* const> cameras;
  core::Clock& clock;
};

struct SessionOptions {
  int attempts = 4;                                         // tries for a frame before the session gives up
  core::Nanoseconds frame_timeout = 500 * core::kMillisecond;  // from the end of the exposure
};

struct SessionReport {
  std::size_t steps = 0;         // of the sequence
  std::size_t already_stored = 0;  // frames found complete when the session began (resumed)
  std::size_t stored = 0;        // frames stored now
  std::size_t retaken = 0;       // frames that needed more than one try
  std::size_t dropped = 0;       // frames that never came (time-out or gap in the camera's count)
  std::size_t discarded = 0;     // duplicated, stale or damaged frames thrown away
  core::Nanoseconds duration = 0;
};

// Takes every frame of `scan` that the store does not hold yet: for each step, lights on, settle, trigger, one frame of each
// camera. A frame belongs to a step only when its time stamp is not before the trigger and its sequence number is new to the
// camera; anything else is discarded, and missing frames are retaken. Every light is off afterwards on every way out: return,
// exception, SIGINT, SIGTERM (stops between frames with Interrupted; what was stored stays, and running again resumes).
// Throws DeviceError when a frame does not come in `attempts` tries, naming step, light and camera.
SessionReport run_session(db::Store& store, const db::Scan& scan, const Sequence& sequence, const Rig& rig,
                          const SessionOptions& options = {});

}  // namespace lightstage::capture
