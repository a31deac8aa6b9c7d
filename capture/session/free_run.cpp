#include "capture/session/free_run.h"

#include <algorithm>

#include "capture/session/latency.h"
#include "capture/session/witness.h"
#include "core/error.h"
#include "core/interrupt.h"

namespace lightstage::capture {

namespace {

constexpr int kPatiencePeriods = 12;  // in which the frames that a stamp line needs come
constexpr std::size_t kStepsBetweenCloses = 16;

class FreePass {
 public:
  explicit FreePass(Pass& pass) : pass_(pass) {}

  void run() {
    std::string trouble = "the last one did not come, or came at a time that leaves its light in doubt";
    while (true) {
      const std::vector<const db::Step*> steps = pass_.unfinished();
      if (steps.empty()) return;
      core::throw_if_interrupted();
      for (const db::Step* step : steps) {
        if (pass_.tries(*step) >= pass_.options().attempts) {
          pass_.give_up(*step, *pass_.cameras_without(*step).front(), trouble);
        }
      }
      try {
        round(with_witness(pass_, steps));
      } catch (const core::DeviceError& error) {
        if (++failures_ >= pass_.options().attempts) throw;
        trouble = error.what();
        core::warn(trouble + "; the steps it cost are taken again");
        pass_.forget_cameras();
        references_.clear();
        matchers_.clear();
      }
    }
  }

 private:
  void round(const std::vector<const db::Step*>& steps) {
    matchers_.clear();
    witnesses_.clear();
    exposure_.reset();
    for (const db::Step* step : steps) measure(step->exposure_ns);
    matchers_.resize(pass_.feeds().size());
    for (std::size_t c = 0; c < pass_.feeds().size(); ++c) {
      witnesses_.emplace_back(brightness_of(references_, c));
    }
    for (const db::Step* step : steps) {
      if (core::interrupt_requested() || lagging()) break;
      set_exposure(step->exposure_ns);
      wait_for_room();
      take(*step);
      if (++steps_since_close_ >= pass_.steps_together(kStepsBetweenCloses)) close();
    }
    // What is still under way comes, or not.
    fetch_until(pass_.now() + latest_ + 2 * period_ + core::kMillisecond);
    close();
    for (std::size_t c = 0; c < witnesses_.size(); ++c) {
      if (!matchers_[c].lagging()) keep_rest(pass_, c, witnesses_[c]);
    }
    if (lagging()) {
      core::note("a camera's time stamps have shifted: its frames since the last tracking frame are taken again");
      references_.clear();
    }
  }

  bool lagging() const {
    return std::any_of(matchers_.begin(), matchers_.end(), [](const FreeRunMatcher& m) { return m.lagging(); });
  }

  void measure(core::Nanoseconds exposure) {
    if (references_.contains(exposure)) return;
    const core::Nanoseconds begin = pass_.now();
    references_.emplace(exposure, measure_free_running(pass_, exposure));
    pass_.report().preparation += pass_.now() - begin;
  }

  // So long that the last frame of one exposure cannot be taken for the first of the other by its stamp.
  void wait_for_change(core::Nanoseconds from, core::Nanoseconds to) {
    core::Nanoseconds wait = 0;
    for (std::size_t c = 0; c < pass_.feeds().size(); ++c) {
      const CameraReference &before = references_.at(from).cameras[c], &after = references_.at(to).cameras[c];
      const core::Nanoseconds later = before.latency.most + before.tolerance - (after.latency.least - after.tolerance);
      wait = std::max(wait, later - from);
    }
    fetch_until(pass_.now() + wait);
  }

  void set_exposure(core::Nanoseconds exposure) {
    if (exposure_ == exposure) return;
    if (exposure_) wait_for_change(*exposure_, exposure);
    exposure_ = exposure;
    const Reference& reference = references_.at(exposure);
    period_ = latest_ = in_doubt_ = 0;
    for (std::size_t c = 0; c < pass_.feeds().size(); ++c) {
      CameraFeed& feed = pass_.feeds()[c];
      feed.set_exposing(Exposing::kFreeRunning);
      feed.set_exposure(exposure);
      const CameraReference& camera = reference.cameras[c];
      period_ = std::max(period_, feed.frame_period());
      latest_ = std::max(latest_, camera.latency.most + camera.tolerance + camera.arrival);
      in_doubt_ = std::max(in_doubt_, camera.latency.range() + 3 * camera.tolerance);
    }
    // The exposure under way and perhaps the one after it are still of the length before.
    const core::Nanoseconds begin = pass_.now() + 2 * period_;
    for (std::size_t c = 0; c < matchers_.size(); ++c) {
      matchers_[c].change(begin, exposure, pass_.feeds()[c].frame_period(), reference.cameras[c].latency,
                          reference.cameras[c].tolerance, reference.cameras[c].arrival);
    }
    fetch_until(begin);
    const core::Nanoseconds patience = begin + latest_ + kPatiencePeriods * period_;
    const auto known = [&] {
      return std::all_of(matchers_.begin(), matchers_.end(), [](const auto& m) { return m.knows_next(); });
    };
    while (!known() && pass_.now() < patience) fetch_until(pass_.now() + core::kMillisecond / 2);
  }

  // The cameras do not wait for the disk, but the lights do: frames of no step are no loss.
  void wait_for_room() {
    if (pass_.has_room(1)) return;
    close();
    while (!pass_.has_room(1) && !core::interrupt_requested()) {
      fetch_until(pass_.now() + core::kMillisecond);
      close();
    }
  }

  void take(const db::Step& step) {
    pass_.begin_try(step);
    pass_.rig().lights.show(pass_.levels_of(step));
    const core::Nanoseconds lit = pass_.now() + pass_.sequence().settle;
    fetch_until(lit);
    // Where nothing is known of the next exposures, one begins within a period, wherever they lie.
    core::Nanoseconds last_start = lit;
    for (const FreeRunMatcher& matcher : matchers_) {
      last_start = std::max(last_start, matcher.next_start(lit).value_or(lit + period_ + in_doubt_));
    }
    last_start = std::min(last_start, lit + period_ + in_doubt_);
    fetch_until(last_start + step.exposure_ns);
    // As it turned out, which is not before the time planned.
    const core::Nanoseconds off = pass_.now();
    for (FreeRunMatcher& matcher : matchers_) matcher.lit(step.step_index, lit, off - step.exposure_ns);
  }

  void fetch_until(core::Nanoseconds time) {
    pass_.listen(time, [&](std::size_t camera, CameraFrame frame) { matchers_[camera].add(std::move(frame)); });
  }

  // Keeps what is certain of the steps whose frames must have come.
  void close() {
    pass_.check_lights();
    steps_since_close_ = 0;
    for (std::size_t c = 0; c < matchers_.size(); ++c) {
      FreeRunMatcher::Closed closed = matchers_[c].close(pass_.now());
      pass_.report().dropped += closed.steps - closed.matched.size();
      keep_admitted(pass_, c, witnesses_[c], std::move(closed.matched));
    }
  }

  Pass& pass_;
  std::map<core::Nanoseconds, Reference> references_;  // by exposure
  int failures_ = 0;

  // Of the round.
  std::vector<FreeRunMatcher> matchers_;  // by camera
  std::vector<Witness> witnesses_;
  std::size_t steps_since_close_ = 0;
  std::optional<core::Nanoseconds> exposure_;
  core::Nanoseconds period_ = 0, latest_ = 0, in_doubt_ = 0;  // of the slowest camera, at that exposure
};

}  // namespace

void run_free(Pass& pass) {
  FreePass(pass).run();
}

}  // namespace lightstage::capture
