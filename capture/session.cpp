#include "capture/session.h"

#include <algorithm>
#include <map>
#include <set>
#include <utility>

#include "capture/session/free_run.h"
#include "capture/session/lights_off.h"
#include "capture/session/lockstep.h"
#include "capture/session/pass.h"
#include "capture/session/pipelined.h"
#include "core/error.h"
#include "core/interrupt.h"
#include "core/progress.h"
#include "core/text.h"

namespace lightstage::capture {

namespace {

std::string list(const std::vector<std::string>& names) {
  return names.empty() ? "(none)" : core::joined(names, ", ");
}

void check(const db::Scan& scan, const Sequence& sequence, const Rig& rig, const SessionOptions& options) {
  const std::string what = "scan '" + scan.name + "'";
  const auto fail = [&](const std::string& problem) {
    throw core::UsageError("cannot capture " + what + ": " + problem);
  };
  if (!std::equal(scan.steps.begin(), scan.steps.end(), sequence.steps.begin(), sequence.steps.end(), same_shot)) {
    fail("it was begun with another sequence; take that one, or another name");
  }
  std::vector<std::string> wanted = scan.cameras, present;
  for (const Camera* camera : rig.cameras) present.push_back(camera->name());
  std::sort(wanted.begin(), wanted.end());
  std::sort(present.begin(), present.end());
  if (wanted != present) fail("it was begun with the cameras " + list(wanted) + ", the rig has " + list(present));
  check_rig(what, sequence, rig, options);
}

void show(const SessionOptions& options, std::span<const KeptFrame> frames) {
  if (!options.on_frame) return;
  for (const KeptFrame& kept : frames) options.on_frame(*kept.step, kept.camera, kept.frame);
}

SessionReport take_all(const std::string& name, const Sequence& sequence, const Rig& rig, const SessionOptions& options,
                       Pass::Stored stored, FrameKeeper::Target target) {
  const core::Nanoseconds start = rig.clock.now();
  // Made first, so that signals are held back until the lights are off.
  const core::InterruptGuard interrupt_guard;
  Pass pass(name, sequence, rig, options, std::move(stored), std::move(target));
  LightsOffGuard lights_off(rig.lights);
  if (sequence.timing == Timing::kPipelined) run_pipelined(pass);
  if (sequence.timing == Timing::kFreeRun) {
    run_free(pass);
  } else {
    run_lockstep(pass);
  }
  lights_off.turn_off();
  pass.finish();
  core::throw_if_interrupted();
  pass.report().duration = rig.clock.now() - start;
  return pass.report();
}

}  // namespace

void check_rig(const std::string& what, const Sequence& sequence, const Rig& rig, const SessionOptions& options) {
  const auto fail = [&](const std::string& problem) {
    throw core::UsageError("cannot capture " + what + ": " + problem);
  };
  if (options.attempts < 1) fail("at least one attempt a frame is needed");
  const std::string timing(to_string(sequence.timing));
  if (sequence.timing != Timing::kFreeRun && !rig.trigger) {
    fail("timing " + timing + " needs a trigger; give the stage file one, or take free_run");
  }
  if (sequence.timing == Timing::kPipelined && !rig.lights.player()) {
    fail("timing pipelined needs LED controllers that hold a sequence; take lockstep");
  }
  for (const db::Step& step : sequence.steps) {
    levels(step, rig.lights.light_count());  // throws for a light that the rig does not have
    if (step.exposure_ns <= 0) fail(describe(step) + " has no exposure");
  }
  std::set<core::Nanoseconds> exposures;
  for (const db::Step& step : sequence.steps) exposures.insert(step.exposure_ns);
  for (Camera* camera : rig.cameras) {
    for (const core::Nanoseconds exposure : exposures) camera->set_exposure(exposure);
  }
}

SessionReport run_session(db::Store& store, const db::Scan& scan, const Sequence& sequence, const Rig& rig,
                          const SessionOptions& options) {
  check(scan, sequence, rig, options);
  const auto stored_frames = [&] {
    Pass::Stored stored;
    for (const db::Frame& frame : store.frames(scan.id)) stored.emplace(frame.step_index, frame.camera);
    return stored;
  };
  const auto explaining = [](const KeptFrame& kept, const auto& work) {
    try {
      work();
    } catch (const core::BadInput& no_picture) {
      throw core::BadInput("camera '" + kept.camera + "', " + describe(*kept.step) + ": " + no_picture.what());
    }
  };
  FrameKeeper::Target target;
  target.write = [&](KeptFrame& kept) {
    explaining(kept, [&] {
      kept.unsynced = store.begin_frame({scan.id, kept.camera, kept.step->step_index, kept.frame.timestamp,
                                         kept.frame.sequence_number, kept.attempt, kept.frame.saturation},
                                        kept.frame.image);
    });
  };
  const auto finish = [&](std::span<KeptFrame> frames) {
    std::vector<db::UnsyncedFrame> unsynced;
    for (KeptFrame& kept : frames) unsynced.push_back(*std::exchange(kept.unsynced, std::nullopt));
    store.finish_frames(std::move(unsynced));
    show(options, frames);
  };
  target.store = [&](std::vector<KeptFrame>& frames) {
    try {
      finish(frames);
    } catch (const core::BadInput&) {  // of a picture that does not fit in: those before it are kept
      for (KeptFrame& kept : frames) {
        target.write(kept);
        explaining(kept, [&] { finish({&kept, 1}); });
      }
    }
  };
  const std::size_t before = stored_frames().size();
  for (int attempt = 1;; ++attempt) {
    try {
      SessionReport report = take_all(scan.name, sequence, rig, options, stored_frames(), target);
      report.already_stored = before;
      report.stored = stored_frames().size() - before;
      report.retaken += std::size_t(attempt) - 1;
      return report;
    } catch (const core::BadInput& refused) {
      if (attempt >= options.attempts) throw core::DeviceError(refused.what());
      core::warn(std::string(refused.what()) + "; it is taken again");
    }
  }
}

SessionReport dry_run(const Sequence& sequence, const Rig& rig, const SessionOptions& options) {
  check_rig("dry run", sequence, rig, options);
  return take_all("dry run", sequence, rig, options, {},
                  {[](KeptFrame&) {}, [&](std::vector<KeptFrame>& frames) { show(options, frames); }});
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
