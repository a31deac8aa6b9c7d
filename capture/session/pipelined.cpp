#include "capture/session/pipelined.h"

#include <algorithm>
#include <set>
#include <span>

#include "capture/session/latency.h"
#include "capture/session/witness.h"
#include "core/error.h"
#include "core/interrupt.h"

namespace lightstage::capture {

namespace {

constexpr std::size_t kLongestRun = 32;  // whose frames are lost together when a controller fails
constexpr core::Nanoseconds kStrobeDelay = 100 * core::kMillisecond;  // after the exposure's end, at most

class PipelinedPass {
 public:
  PipelinedPass(Pass& pass, PatternPlayer& player)
      : pass_(pass), player_(player), steps_(with_witness(pass, pass.unfinished())) {}

  void run() {
    const core::Nanoseconds begin = pass_.now();
    for (const db::Step* step : steps_) {
      if (!references_.contains(step->exposure_ns)) references_.emplace(step->exposure_ns, measure(step->exposure_ns));
    }
    for (const auto& [exposure, reference] : references_) {
      longest_trigger_ = std::max(longest_trigger_, reference.longest_trigger);
    }
    for (std::size_t c = 0; c < pass_.feeds().size(); ++c) {
      witnesses_.emplace_back(brightness_of(references_, c));
    }
    pass_.report().preparation = pass_.now() - begin;
    std::size_t first = 0;
    int failures = 0;
    while (first < steps_.size()) {
      core::throw_if_interrupted();
      const std::span<const db::Step* const> run = run_from(first);
      try {
        first += take(run, first);
      } catch (const core::DeviceError& error) {
        core::warn(std::string(error.what()) + "; the steps it cost are taken again");
        pass_.forget_cameras();
        loaded_ = false;
        if (++failures >= pass_.options().attempts) break;
        first += run.size();
      }
    }
    for (std::size_t c = 0; c < pass_.feeds().size(); ++c) keep_rest(pass_, c, witnesses_[c]);
  }

 private:
  Reference measure(core::Nanoseconds exposure) {
    for (int attempt = 1;; ++attempt) {
      try {
        return measure_triggered(pass_, exposure);
      } catch (const core::DeviceError& error) {
        if (attempt >= pass_.options().attempts) throw;
        core::warn(std::string(error.what()) + "; measuring the cameras' time stamps again");
        pass_.forget_cameras();
      }
    }
  }

  void load() {
    if (loaded_) return;
    std::vector<std::vector<LightLevel>> patterns;
    for (const db::Step* step : steps_) patterns.push_back(pass_.levels_of(*step));
    player_.load(patterns);
    loaded_ = true;
  }

  // Steps from this one on that follow each other with one exposure.
  std::span<const db::Step* const> run_from(std::size_t first) const {
    const std::size_t longest = pass_.steps_together(kLongestRun);
    std::size_t end = first;
    while (end < steps_.size() && end - first < longest && steps_[end]->exposure_ns == steps_[first]->exposure_ns) {
      ++end;
    }
    return std::span(steps_).subspan(first, end - first);
  }

  // How many steps of the run it has been through, at least one; what it did not take of them is taken again later.
  std::size_t take(std::span<const db::Step* const> run, std::size_t first) {
    const core::Nanoseconds exposure = run.front()->exposure_ns;
    const Reference& reference = references_.at(exposure);
    std::size_t passed = run.size();
    std::vector<TriggeredMatcher> matchers;
    std::set<int> mixed;
    core::Nanoseconds pace = 0;
    for (std::size_t c = 0; c < pass_.feeds().size(); ++c) {
      CameraFeed& feed = pass_.feeds()[c];
      feed.set_exposing(Exposing::kTriggered);
      feed.set_exposure(exposure);
      pass_.report().discarded += feed.flush(pass_.now());
      matchers.emplace_back(reference.cameras[c].latency, feed.last_number());
      // Exposures nearer than the uncertainty of their stamps could not be told apart.
      pace = std::max(pace, reference.cameras[c].latency.range() + longest_trigger_);
    }
    load();
    // The last camera is triggered so much after the first, and may be a little slower to begin.
    const core::Nanoseconds hold = longest_trigger_ + pass_.sequence().hold;
    player_.arm(first, hold);
    settle_from(pass_.now());
    for (std::size_t i = 0; i < run.size(); ++i) {
      // A strobe that was heard twice, or noise on its wire, lit another pattern too soon.
      if (player_.position() != first + i) {
        core::note(describe(*run[i]) +
                   ": the controller is at another pattern; this step and the one before are taken again");
        if (i > 0) mixed.insert(run[i - 1]->step_index);
        break;
      }
      pass_.begin_try(*run[i]);
      const auto [called, triggered] = pass_.trigger();
      for (TriggeredMatcher& matcher : matchers) matcher.expect(run[i]->step_index, called, triggered);
      // The last camera may have been triggered later than the lights were held for it: its exposure saw two steps' lights.
      if (triggered - called > hold) mixed.insert(run[i]->step_index);
      longest_trigger_ = std::max(longest_trigger_, triggered - called);  // for the next run
      const std::optional<core::Nanoseconds> lit =
          player_.wait_for_pattern(first + i + 1, pass_.now() + exposure + hold + kStrobeDelay);
      // Which pattern is lit is no longer known: the exposure may not have happened, or its strobe was not heard.
      if (!lit || *lit < called || *lit > pass_.now()) {
        core::note(describe(*run[i]) + ": the controller heard no strobe; it and what follows are taken again");
        break;
      }
      fetch(matchers);
      // Whatever followed would be taken again: a new run counts anew.
      const bool lost_count =
          std::any_of(matchers.begin(), matchers.end(), [](const auto& m) { return m.lost_count(); });
      settle_from(*lit);
      pass_.rig().clock.sleep_until(called + pace);
      // Interrupted: what was exposed is kept, then the caller stops.
      if (!lost_count && !core::interrupt_requested() && i + 1 < run.size()) continue;
      if (player_.position() != first + i + 1) mixed.insert(run[i]->step_index);
      passed = i + 1;
      break;
    }
    wait_for_frames(matchers, reference);
    pass_.check_lights();
    for (std::size_t c = 0; c < matchers.size(); ++c) close(c, matchers[c], mixed);
    return passed;
  }

  void settle_from(core::Nanoseconds lit) { pass_.rig().clock.sleep_until(lit + pass_.sequence().settle); }

  // What has come by now.
  void fetch(std::vector<TriggeredMatcher>& matchers) {
    for (std::size_t c = 0; c < matchers.size(); ++c) {
      while (std::optional<CameraFrame> frame = pass_.feeds()[c].next(pass_.now())) matchers[c].add(std::move(*frame));
    }
  }

  // Frames that come later than any that was measured are not matched anyway.
  void wait_for_frames(std::vector<TriggeredMatcher>& matchers, const Reference& reference) {
    const core::Nanoseconds last_trigger = pass_.now();
    for (std::size_t c = 0; c < matchers.size(); ++c) {
      const core::Nanoseconds deadline =
          last_trigger + reference.cameras[c].latency.most + reference.cameras[c].arrival;
      while (matchers[c].outstanding() > 0) {
        std::optional<CameraFrame> frame = pass_.feeds()[c].next(deadline);
        if (!frame) break;
        matchers[c].add(std::move(*frame));
      }
    }
  }

  void close(std::size_t camera, TriggeredMatcher& matcher, const std::set<int>& mixed) {
    pass_.report().dropped += matcher.outstanding();
    const std::size_t arrived = matcher.arrived();
    std::vector<MatchedFrame> matched = matcher.close();
    std::erase_if(matched, [&](const MatchedFrame& m) { return mixed.contains(m.step); });
    pass_.report().discarded += arrived - matched.size();
    keep_admitted(pass_, camera, witnesses_[camera], std::move(matched));
  }

  Pass& pass_;
  PatternPlayer& player_;
  std::vector<const db::Step*> steps_;
  std::map<core::Nanoseconds, Reference> references_;  // by exposure
  std::vector<Witness> witnesses_;                     // by camera
  core::Nanoseconds longest_trigger_ = 0;              // as Reference's, so far
  bool loaded_ = false;
};

}  // namespace

void run_pipelined(Pass& pass) {
  if (!pass.unfinished().empty()) PipelinedPass(pass, *pass.rig().lights.player()).run();
}

}  // namespace lightstage::capture
