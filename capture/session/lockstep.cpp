#include "capture/session/lockstep.h"

#include <algorithm>

#include "core/error.h"
#include "core/interrupt.h"

namespace lightstage::capture {

namespace {

// A strobe that has not been heard of so long after the exposure was not given (input lines may be polled).
constexpr core::Nanoseconds kStrobeDelay = 120 * core::kMillisecond;

// Exposes every camera once, with nothing old left in its queue. Returns a time that no frame of this
// exposure begins before and every frame of an earlier one does.
core::Nanoseconds trigger(Pass& pass, const db::Step& step) {
  for (CameraFeed& feed : pass.feeds()) {
    feed.set_exposing(Exposing::kTriggered);
    feed.set_exposure(step.exposure_ns);
    pass.report().discarded += feed.flush(pass.now());
  }
  if (pass.rig().strobe) pass.rig().strobe->clear();
  return pass.trigger().called;
}

void light(Pass& pass, const db::Step& step) {
  pass.rig().lights.show(pass.levels_of(step));
  pass.rig().clock.sleep_until(pass.now() + pass.sequence().settle);
}

struct Exposure {
  core::Nanoseconds trigger_time = 0, deadline = 0;
  std::optional<bool> happened;  // as the strobe tells; empty while it has not been asked
};

// Asks the strobe, once, when a frame is late: where there was no exposure there is nothing to wait for.
bool happened(Pass& pass, Exposure& exposure, core::Nanoseconds asked_by) {
  if (!pass.rig().strobe) return true;
  if (!exposure.happened) exposure.happened = pass.rig().strobe->wait_exposure(asked_by).has_value();
  return *exposure.happened;
}

// The lights do not change before this returns, so a frame that began after the trigger saw this step's
// light alone.
std::optional<CameraFrame> receive(Pass& pass, CameraFeed& feed, const db::Step& step, Exposure& exposure,
                                   std::string& trouble) {
  const core::Nanoseconds strobe_by = exposure.trigger_time + step.exposure_ns + kStrobeDelay;
  CameraFeed::Result result = feed.receive(
      exposure.trigger_time, pass.rig().strobe ? std::min(strobe_by, exposure.deadline) : exposure.deadline);
  pass.report().discarded += result.discarded;
  const bool waiting = !result.frame && !result.damaged;
  if (waiting && pass.now() < exposure.deadline && happened(pass, exposure, strobe_by)) {
    result = feed.receive(exposure.trigger_time, exposure.deadline);
    pass.report().discarded += result.discarded;
  }
  if (result.damaged) {
    trouble = "the last one came damaged";
  } else if (!result.frame) {
    ++pass.report().dropped;
    const bool unexposed = exposure.happened && !*exposure.happened;
    trouble = unexposed ? "its strobe says that it did not expose when it was triggered (look at the trigger's wiring)"
                        : "the last one did not come in time";
  }
  return std::move(result.frame);
}

// A frame that did not come in time may come yet, and would be taken for another exposure's by its stamp, where a camera
// stamps frames when they arrive. So nothing is exposed for as long as a frame was waited for, and what comes is thrown away:
// before a step is tried again, and before the lights change after that.
void let_late_frames_come(Pass& pass) {
  const core::Nanoseconds until = pass.now() + pass.options().frame_timeout;
  for (CameraFeed& feed : pass.feeds()) {
    try {
      while (feed.next(until)) ++pass.report().discarded;
    } catch (const core::DeviceError&) {  // one that is gone sends nothing any more; the next try will tell
      feed.forget();
    }
  }
  pass.rig().clock.sleep_until(until);
}

void take(Pass& pass, const db::Step& step) {
  std::string trouble;
  bool frames_may_come = false;
  for (int attempt = 1;; ++attempt) {
    const std::vector<CameraFeed*> missing = pass.cameras_without(step);
    if (frames_may_come) let_late_frames_come(pass);
    if (missing.empty()) return;
    core::throw_if_interrupted();
    // The camera that was asked last is the one that `trouble` is about.
    if (attempt > pass.options().attempts) pass.give_up(step, *missing.back(), trouble);
    pass.begin_try(step);
    std::vector<std::pair<CameraFeed*, CameraFrame>> received;
    try {
      light(pass, step);
      Exposure exposure;
      exposure.trigger_time = trigger(pass, step);
      exposure.deadline = exposure.trigger_time + step.exposure_ns + pass.options().frame_timeout;
      for (CameraFeed* feed : missing) {
        if (auto frame = receive(pass, *feed, step, exposure, trouble)) {
          received.emplace_back(feed, std::move(*frame));
        } else {
          frames_may_come = true;
        }
      }
    } catch (const core::DeviceError& error) {
      trouble = error.what();
      pass.forget_cameras();
      frames_may_come = true;
    }
    // One camera's trouble does not spoil another's frame, lights that went out do.
    try {
      if (!received.empty()) pass.check_lights();
    } catch (const core::DeviceError& error) {
      trouble = error.what();
      pass.report().discarded += received.size();
      received.clear();
    }
    for (auto& [feed, frame] : received) pass.keep(step, *feed, std::move(frame));
  }
}

}  // namespace

void run_lockstep(Pass& pass) {
  for (const db::Step* step : pass.unfinished()) take(pass, *step);
}

}  // namespace lightstage::capture
