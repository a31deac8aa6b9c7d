#include "capture/session.h"

#include <set>

#include "capture/session/camera_feed.h"
#include "capture/session/lights_off.h"
#include "core/error.h"
#include "core/interrupt.h"
#include "core/progress.h"

namespace lightstage::capture {

namespace {

std::string describe(const db::Step& step) {
  const std::string light = step.light_index ? ", light " + std::to_string(*step.light_index) : "";
  return "step " + std::to_string(step.step_index) + " (" + std::string(db::to_string(step.kind)) + light + ")";
}

std::string joined(const std::vector<std::string>& names) {
  std::string text;
  for (const std::string& name : names) text += (text.empty() ? "" : ", ") + name;
  return text.empty() ? "(none)" : text;
}

void check(const db::Scan& scan, const Sequence& sequence, const Rig& rig, const SessionOptions& options) {
  const auto fail = [&](const std::string& problem) {
    throw core::UsageError("cannot capture scan '" + scan.name + "': " + problem);
  };
  if (options.attempts < 1) fail("at least one attempt a frame is needed");
  if (!std::equal(scan.steps.begin(), scan.steps.end(), sequence.steps.begin(), sequence.steps.end(), same_shot)) {
    fail("it was begun with another sequence; take that one, or another name");
  }
  std::vector<std::string> wanted = scan.cameras, present;
  for (const Camera* camera : rig.cameras) present.push_back(camera->name());
  std::sort(wanted.begin(), wanted.end());
  std::sort(present.begin(), present.end());
  if (wanted != present) fail("it was begun with the cameras " + joined(wanted) + ", the rig has " + joined(present));
  for (const db::Step& step : sequence.steps) {
    levels(step, rig.lights.light_count());  // throws for a light that the rig does not have
    if (step.exposure_ns <= 0) fail(describe(step) + " has no exposure");
  }
}

class Session {
 public:
  Session(db::Store& store, const db::Scan& scan, const Sequence& sequence, const Rig& rig,
          const SessionOptions& options)
      : store_(store), scan_(scan), sequence_(sequence), rig_(rig), options_(options) {
    for (Camera* camera : rig.cameras) feeds_.emplace_back(*camera);
    for (const db::Frame& frame : store.frames(scan.id)) stored_.emplace(frame.step_index, frame.camera);
  }

  SessionReport run() {
    const core::Nanoseconds start = rig_.clock.now();
    report_.steps = sequence_.steps.size();
    report_.already_stored = stored_.size();
    core::Progress progress("capture " + scan_.name, report_.steps * feeds_.size() - report_.already_stored);
    for (const db::Step& step : sequence_.steps) take(step, progress);
    core::throw_if_interrupted();
    report_.duration = rig_.clock.now() - start;
    return report_;
  }

 private:
  void take(const db::Step& step, core::Progress& progress) {
    std::string trouble;
    for (int attempt = 1;; ++attempt) {
      const std::vector<CameraFeed*> missing = cameras_without(step);
      if (missing.empty()) return;
      core::throw_if_interrupted();
      // The camera that was asked last is the one that `trouble` is about.
      if (attempt > options_.attempts) give_up(step, *missing.back(), trouble);
      try {
        light(step);
        const core::Nanoseconds trigger_time = trigger(step);
        for (CameraFeed* feed : missing) receive(*feed, step, trigger_time, trouble);
      } catch (const core::DeviceError& error) {
        trouble = error.what();
        // A device that failed may have started anew.
        for (CameraFeed& feed : feeds_) feed.forget_exposure();
      }
      store_received(step, attempt, progress);
    }
  }

  std::vector<CameraFeed*> cameras_without(const db::Step& step) {
    std::vector<CameraFeed*> missing;
    for (CameraFeed& feed : feeds_) {
      if (!stored_.contains({step.step_index, feed.name()})) missing.push_back(&feed);
    }
    return missing;
  }

  void light(const db::Step& step) {
    rig_.lights.show(levels(step, rig_.lights.light_count()));
    rig_.clock.sleep_until(rig_.clock.now() + sequence_.settle);
  }

  // Exposes every camera once, with nothing old left in its queue. Returns a time that no frame of this
  // exposure begins before and every frame of an earlier one does.
  core::Nanoseconds trigger(const db::Step& step) {
    for (CameraFeed& feed : feeds_) {
      feed.set_exposure(step.exposure_ns);
      report_.discarded += feed.flush(rig_.clock.now());
    }
    const core::Nanoseconds trigger_time = rig_.clock.now();
    rig_.trigger->fire();
    return trigger_time;
  }

  // The lights do not change before this returns, so a frame that began after the trigger saw this step's
  // light alone.
  void receive(CameraFeed& feed, const db::Step& step, core::Nanoseconds trigger_time, std::string& trouble) {
    const core::Nanoseconds deadline = trigger_time + step.exposure_ns + options_.frame_timeout;
    CameraFeed::Result result = feed.receive(trigger_time, deadline);
    report_.discarded += result.discarded;
    if (result.frame) {
      received_.push_back({feed.name(), std::move(*result.frame)});
    } else if (result.damaged) {
      trouble = "the last one came damaged";
    } else {
      ++report_.dropped;
      trouble = "the last one did not come in time";
    }
  }

  void store_received(const db::Step& step, int attempt, core::Progress& progress) {
    for (const auto& [camera, frame] : received_) {
      store_.put_frame(
          {scan_.id, camera, step.step_index, frame.timestamp, frame.sequence_number, attempt, frame.saturation},
          frame.image);
      stored_.emplace(step.step_index, camera);
      ++report_.stored;
      if (attempt > 1) ++report_.retaken;
      progress.set_status(describe(step) + ", " + std::to_string(report_.dropped) + " dropped, " +
                          std::to_string(report_.retaken) + " retaken");
      progress.advance();
    }
    received_.clear();
  }

  [[noreturn]] void give_up(const db::Step& step, const CameraFeed& feed, const std::string& trouble) const {
    throw core::DeviceError("camera '" + feed.name() + "' gave no good frame of " + describe(step) + " in " +
                            std::to_string(options_.attempts) + " tries: " + trouble +
                            "; what was stored is kept, check the device and resume");
  }

  db::Store& store_;
  const db::Scan& scan_;
  const Sequence& sequence_;
  const Rig& rig_;
  const SessionOptions& options_;
  std::vector<CameraFeed> feeds_;
  std::set<std::pair<int, std::string>> stored_;               // step and camera
  std::vector<std::pair<std::string, CameraFrame>> received_;  // of the current exposure, by camera
  SessionReport report_;
};

}  // namespace

SessionReport run_session(db::Store& store, const db::Scan& scan, const Sequence& sequence, const Rig& rig,
                          const SessionOptions& options) {
  check(scan, sequence, rig, options);
  // Made first, so that signals are held back until the lights are off.
  const core::InterruptGuard interrupt_guard;
  LightsOffGuard lights_off(rig.lights);
  Session session(store, scan, sequence, rig, options);
  const SessionReport report = session.run();
  lights_off.turn_off();
  return report;
}

core::Nanoseconds end_of_last_exposure(const db::Store& store, const db::Scan& scan) {
  std::map<int, core::Nanoseconds> exposures;
  for (const db::Step& step : scan.steps) exposures[step.step_index] = step.exposure_ns;
  core::Nanoseconds end = 0;
  for (const db::Frame& frame : store.frames(scan.id)) {
    end = std::max(end, frame.timestamp_ns + exposures[frame.step_index]);
  }
  return end;
}

}  // namespace lightstage::capture
