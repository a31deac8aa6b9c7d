#include "capture/session/free_run.h"

#include "capture/session/latency.h"
#include "capture/session/runs.h"
#include "capture/session/witness.h"
#include "core/error.h"
#include "core/interrupt.h"

namespace lightstage::capture {

namespace {

constexpr std::size_t kLongestRun = 64;
constexpr core::Nanoseconds kPoll = core::kMillisecond / 2;  // between looks for frames
constexpr int kFramesForALine = 7;

class FreePass {
 public:
  explicit FreePass(Pass& pass) : pass_(pass) {}

  void run() {
    std::string trouble = "the last one did not come, or came at a time that leaves its light in doubt";
    while (true) {
      const std::vector<const db::Step*> steps = pass_.unfinished();
      if (steps.empty()) return;
      for (const db::Step* step : steps) {
        if (pass_.tries(*step) >= pass_.options().attempts) {
          pass_.give_up(*step, *pass_.cameras_without(*step).front(), trouble);
        }
      }
      try {
        round(steps);
      } catch (const core::DeviceError& error) {
        if (++failures_ >= pass_.options().attempts) throw;
        trouble = error.what();
        core::warn(trouble + "; the steps it cost are taken again");
        pass_.forget_cameras();
        references_.clear();
      }
    }
  }

 private:
  void round(const std::vector<const db::Step*>& steps) {
    std::vector<Witness> witnesses;
    for (const Run& run : cut_into_runs(steps, kLongestRun)) {
      core::throw_if_interrupted();
      prepare(run.exposure);
      if (witnesses.empty()) {
        for (const CameraReference& camera : references_.at(run.exposure).cameras) witnesses.emplace_back(camera);
      }
      take(run, witnesses);
    }
    for (std::size_t c = 0; c < witnesses.size(); ++c) keep(c, witnesses[c].rest());
  }

  void prepare(core::Nanoseconds exposure) {
    if (!references_.contains(exposure)) {
      const core::Nanoseconds begin = pass_.now();
      references_.emplace(exposure, measure_free_running(pass_, exposure));
      pass_.report().preparation += pass_.now() - begin;
    }
    for (CameraFeed& feed : pass_.feeds()) {
      feed.set_exposing(Exposing::kFreeRunning);
      feed.set_exposure(exposure);
    }
  }

  void take(const Run& run, std::vector<Witness>& witnesses) {
    const Reference& reference = references_.at(run.exposure);
    std::vector<FreeRunMatcher> matchers;
    core::Nanoseconds period = 0, latest = 0, in_doubt = 0;
    for (std::size_t c = 0; c < pass_.feeds().size(); ++c) {
      const CameraReference& camera = reference.cameras[c];
      matchers.emplace_back(camera.latency, pass_.feeds()[c].frame_period(), camera.tolerance);
      period = std::max(period, pass_.feeds()[c].frame_period());
      latest = std::max(latest, camera.latency.most + camera.tolerance);
      in_doubt = std::max(in_doubt, camera.latency.range() + 3 * camera.tolerance);
    }
    // Exposures of the length set before run out, and the line of the new ones is found.
    if (exposure_ != run.exposure) {
      fetch_until(nullptr, pass_.now() + 2 * period + latest);
      exposure_ = run.exposure;
    }
    fetch_until(&matchers, pass_.now() + kFramesForALine * period);

    for (const db::Step* step : run.steps) {
      if (core::interrupt_requested()) break;
      pass_.begin_try(*step);
      pass_.rig().lights.show(pass_.levels_of(*step));
      const core::Nanoseconds lit = pass_.now() + pass_.sequence().settle;
      fetch_until(&matchers, lit);
      core::Nanoseconds last_start = lit + period + in_doubt;
      bool known = true;
      core::Nanoseconds soonest = lit;
      for (const FreeRunMatcher& matcher : matchers) {
        const std::optional<core::Nanoseconds> start = matcher.next_start(lit);
        known = known && start.has_value();
        if (start) soonest = std::max(soonest, *start);
      }
      if (known) last_start = std::min(last_start, soonest);
      fetch_until(&matchers, last_start + run.exposure);
      // As it turned out, which is not before the time planned.
      const core::Nanoseconds off = pass_.now();
      for (FreeRunMatcher& matcher : matchers) matcher.lit(step->step_index, lit, off - run.exposure);
    }
    pass_.check_lights();
    fetch_until(&matchers, pass_.now() + latest + period);
    for (std::size_t c = 0; c < matchers.size(); ++c) close(run, c, matchers[c], witnesses[c]);
  }

  // Takes what comes until then; throws it away where there are no matchers.
  void fetch_until(std::vector<FreeRunMatcher>* matchers, core::Nanoseconds time) {
    while (true) {
      for (std::size_t c = 0; c < pass_.feeds().size(); ++c) {
        while (std::optional<CameraFrame> frame = pass_.feeds()[c].next(pass_.now())) {
          if (matchers) (*matchers)[c].add(std::move(*frame));
        }
      }
      if (pass_.now() >= time) return;
      pass_.rig().clock.sleep_until(std::min(time, pass_.now() + kPoll));
    }
  }

  void close(const Run& run, std::size_t camera, FreeRunMatcher& matcher, Witness& witness) {
    std::vector<MatchedFrame> matched = matcher.close();
    std::size_t wanted = 0;
    for (const db::Step* step : run.steps) {
      if (pass_.tries(*step) > 0 && pass_.missing(*step, pass_.feeds()[camera])) ++wanted;
    }
    pass_.report().dropped += wanted > matched.size() ? wanted - matched.size() : 0;
    Witness::Verdict verdict = witness.hear(std::move(matched), pass_.sequence().steps);
    pass_.report().discarded += verdict.refused;
    keep(camera, std::move(verdict.admitted));
  }

  void keep(std::size_t camera, std::vector<MatchedFrame> frames) {
    for (MatchedFrame& frame : frames) {
      pass_.keep(pass_.step(frame.step), pass_.feeds()[camera], std::move(frame.frame));
    }
  }

  Pass& pass_;
  std::map<core::Nanoseconds, Reference> references_;  // by exposure
  core::Nanoseconds exposure_ = 0;                     // that the cameras' frames have by now
  int failures_ = 0;
};

}  // namespace

void run_free(Pass& pass) {
  FreePass(pass).run();
}

}  // namespace lightstage::capture
