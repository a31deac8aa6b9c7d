#include "capture/session/witness.h"

namespace lightstage::capture {

namespace {
// More than this does not wait: one camera's share of memory.
constexpr std::size_t kMostWaitingBytes = std::size_t{1} << 30;
}  // namespace

bool Witness::plausible(const MatchedFrame& frame, const db::Step& step) const {
  const auto [dark, full] = brightness_.at(step.exposure_ns);
  const double middle = (dark + full) / 2;
  switch (step.kind) {
    case db::StepKind::kDark:
      return mean_value(frame.frame.image) < middle;
    case db::StepKind::kFullOn:
    case db::StepKind::kTracking:
      return mean_value(frame.frame.image) > middle;
    default:
      return true;
  }
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

}  // namespace lightstage::capture
