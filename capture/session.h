// Runs a sequence over cameras and lights into the store.
#pragma once

#include <functional>
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
  Trigger* trigger = nullptr;  // null where cameras only run free
  std::span<Camera* const> cameras;
  core::Clock& clock;
  Strobe* strobe = nullptr;  // of the first camera, where one is wired
};

struct SessionOptions {
  int attempts = 4;                                            // tries for a frame before the session gives up
  core::Nanoseconds frame_timeout = 500 * core::kMillisecond;  // from the end of the exposure
  // Called for each frame after it is stored, on another thread; for previews.
  std::function<void(const db::Step&, const std::string& camera, const CameraFrame&)> on_frame;
};

struct SessionReport {
  std::size_t steps = 0;           // of the sequence
  std::size_t already_stored = 0;  // frames found complete when the session began (resumed)
  std::size_t stored = 0;          // frames stored now
  std::size_t retaken = 0;         // frames that needed more than one try
  std::size_t dropped = 0;         // frames that did not come in time
  // Frames thrown away: duplicated, stale, damaged, of a step that is not certain, or of a camera that had the step already
  // when another one's was retaken. Of cameras that run free, only those refused for their brightness.
  std::size_t discarded = 0;
  core::Nanoseconds duration = 0;
  core::Nanoseconds preparation = 0;  // of that, for measuring the cameras' time stamps (fast modes)
};

// That this rig can take this sequence: its timing mode, its lights, and every exposure, which is set on every camera once.
// Lights nothing. Throws UsageError, BadInput and DeviceError as run_session; `what` names the pass in messages.
void check_rig(const std::string& what, const Sequence& sequence, const Rig& rig, const SessionOptions& options = {});

// Takes every frame of `scan` that the store does not hold yet, in the sequence's timing mode. A frame is stored only when
// it certainly shows its step's light; what is lost or uncertain is taken again. A DeviceError of any device costs a try. A frame that the store refuses
// (a picture with NaN in it) ends a round of the pass, and what is missing is taken in another.
// In modes lockstep and pipelined the devices are triggered; what pipelined loses is taken again in lockstep.
//
// Every light is off afterwards on every way out: return, exception, SIGINT, SIGTERM (stops between frames with
// Interrupted; what was stored stays, and running again resumes). A controller that fails to turn its lights off is
// asked five times; then DeviceError, or a warning when another exception is on its way.
//
// Throws UsageError when the scan in the store has another sequence or other cameras, or the rig cannot do the timing mode,
// BadInput when the sequence names lights that the rig does not have (nothing is lit then), and DeviceError when a frame does
// not come in `attempts` tries, naming step, light, camera and the last trouble.
SessionReport run_session(db::Store& store, const db::Scan& scan, const Sequence& sequence, const Rig& rig,
                          const SessionOptions& options = {});

// The same with nothing stored: how fast and how reliably this rig goes. Throws as run_session.
SessionReport dry_run(const Sequence& sequence, const Rig& rig, const SessionOptions& options = {});

// When the exposure of the last stored frame ended, on the clock of the session that took it; 0 when nothing
// is stored. A simulated pass that is resumed goes on from there:
// clock.sleep_until(end_of_last_exposure(store, scan)).
core::Nanoseconds end_of_last_exposure(const db::Store& store, const db::Scan& scan);

}  // namespace lightstage::capture
