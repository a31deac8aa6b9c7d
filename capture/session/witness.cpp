#include "capture/session/witness.h"

#include <algorithm>

namespace lightstage::capture {

namespace {
// More than this does not wait: one camera's share of memory.
constexpr std::size_t kMostWaitingBytes = std::size_t{1} << 30;
}  // namespace

bool is_bright(db::StepKind kind) {
  return kind == db::StepKind::kFullOn || kind == db::StepKind::kTracking;
}

bool Witness::plausible(const MatchedFrame& frame, const db::Step& step) const {
  const auto [dark, full] = brightness_.at(step.exposure_ns);
  const double middle = (dark + full) / 2;
  if (is_bright(step.kind)) return mean_value(frame.frame.image) > middle;
  return step.kind != db::StepKind::kDark || mean_value(frame.frame.image) < middle;
}

Witness::Verdict Witness::hear(std::vector<MatchedFrame> frames, const std::vector<db::Step>& steps) {
  Verdict verdict;
  for (MatchedFrame& frame : frames) {
    const db::Step& step = steps[static_cast<std::size_t>(frame.step)];
    const bool is_witness = step.kind != db::StepKind::kLight && step.kind != db::StepKind::kPattern;
    if (!plausible(frame, step)) {
      verdict.refused += waiting_.size() + 1;
      waiting_.clear();
      waiting_bytes_ = 0;
      continue;
    }
    waiting_bytes_ += frame.frame.image.values().size_bytes();
    waiting_.push_back(std::move(frame));
    if (!is_witness && waiting_bytes_ < kMostWaitingBytes) continue;
    for (MatchedFrame& good : rest()) verdict.admitted.push_back(std::move(good));
  }
  return verdict;
}

std::vector<MatchedFrame> Witness::rest() {
  waiting_bytes_ = 0;
  return std::exchange(waiting_, {});
}

namespace {
void keep(Pass& pass, std::size_t camera, std::vector<MatchedFrame> frames) {
  for (MatchedFrame& frame : frames) {
    pass.keep(pass.step(frame.step), pass.feeds()[camera], std::move(frame.frame));
  }
}
}  // namespace

void keep_admitted(Pass& pass, std::size_t camera, Witness& witness, std::vector<MatchedFrame> frames) {
  Witness::Verdict verdict = witness.hear(std::move(frames), pass.sequence().steps);
  pass.report().discarded += verdict.refused;
  keep(pass, camera, std::move(verdict.admitted));
}

std::vector<const db::Step*> with_witness(const Pass& pass, std::vector<const db::Step*> steps) {
  const std::vector<db::Step>& all = pass.sequence().steps;
  const auto witness = std::find_if(all.rbegin(), all.rend(), [](const db::Step& s) { return is_bright(s.kind); });
  if (witness != all.rend() && !is_bright(steps.back()->kind)) steps.push_back(&*witness);
  return steps;
}

void keep_rest(Pass& pass, std::size_t camera, Witness& witness) {
  std::vector<MatchedFrame> rest = witness.rest();
  const std::vector<db::Step>& steps = pass.sequence().steps;
  if (std::any_of(steps.begin(), steps.end(), [](const db::Step& step) { return is_bright(step.kind); })) {
    pass.report().discarded += rest.size();
  } else {
    keep(pass, camera, std::move(rest));
  }
}

}  // namespace lightstage::capture
