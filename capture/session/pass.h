// What the timing modes share: which frames are missing, where they go, and what happened so far.
#pragma once

#include <functional>
#include <map>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "capture/session.h"
#include "capture/session/camera_feed.h"
#include "capture/session/frame_keeper.h"
#include "core/progress.h"

namespace lightstage::capture {

class Pass {
 public:
  using Stored = std::set<std::pair<int, std::string>>;  // step index and camera

  // Frames go to `target` on other threads. All references must outlive the pass.
  Pass(const std::string& name, const Sequence& sequence, const Rig& rig, const SessionOptions& options, Stored stored,
       FrameKeeper::Target target);

  const Sequence& sequence() const { return sequence_; }
  const Rig& rig() const { return rig_; }
  const SessionOptions& options() const { return options_; }
  core::Nanoseconds now() const { return rig_.clock.now(); }
  std::vector<CameraFeed>& feeds() { return feeds_; }
  SessionReport& report() { return report_; }

  const db::Step& step(int step_index) const { return sequence_.steps[static_cast<std::size_t>(step_index)]; }
  std::vector<LightLevel> levels_of(const db::Step& step) const;
  bool missing(const db::Step& step, const CameraFeed& feed) const;
  std::vector<CameraFeed*> cameras_without(const db::Step& step);
  std::vector<const db::Step*> unfinished();

  // Counts and returns how often the step has been tried, this time included.
  int begin_try(const db::Step& step) { return ++tries_[step.step_index]; }
  int tries(const db::Step& step) const;

  // Triggers all cameras, not before each of them is ready for it: one that is asked too soon misses the trigger.
  struct Triggered {
    core::Nanoseconds called = 0,
                      triggered = 0;  // no exposure began before the first; all were asked for by the second
  };
  Triggered trigger();

  // Hands over every frame that comes until then, with the index of its camera. Returns in time also where frames come faster
  // than this machine can take them: lights are on meanwhile. The driver drops what is not fetched.
  void listen(core::Nanoseconds until, const std::function<void(std::size_t, CameraFrame)>& hear);
  // After a device failed: cameras may have started anew.
  void forget_cameras();

  // Throws DeviceError when the controller has switched lights off by itself since it was told to light them: what was
  // exposed meanwhile shows too little light. Ask after the exposures and before their frames are kept.
  void check_lights();

  // Hands the frame on to be stored, unless it is there already (then it is discarded). Throws what storing threw.
  void keep(const db::Step& step, const CameraFeed& feed, CameraFrame frame);
  // How many steps' frames may be held back together: `most`, or fewer where they would take more than a gigabyte.
  std::size_t steps_together(std::size_t most) const;
  // Whether keep() would take the frames of so many steps without waiting for the disk.
  bool has_room(std::size_t steps) { return keeper_.has_room(steps * step_bytes()); }
  // Returns when all frames are stored.
  void finish() { keeper_.finish(); }

  // Ends the session with DeviceError.
  [[noreturn]] void give_up(const db::Step& step, const CameraFeed& feed, const std::string& trouble) const;

 private:
  std::size_t step_bytes() const;
  void show_progress(const db::Step& step);

  const Sequence& sequence_;
  const Rig& rig_;
  const SessionOptions& options_;
  std::vector<CameraFeed> feeds_;
  Stored stored_;
  std::map<int, int> tries_;
  SessionReport report_;
  core::Nanoseconds begin_;
  core::Nanoseconds cameras_ready_ = 0;  // for the next trigger
  LedStatus lights_status_;              // as last asked
  core::Progress progress_;
  FrameKeeper keeper_;
};

// "step 4 (light, light 1)"
std::string describe(const db::Step& step);

}  // namespace lightstage::capture
