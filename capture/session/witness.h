// Frames whose brightness is known, as evidence that none before them was given to the wrong step.
#pragma once

#include <map>
#include <vector>

#include "capture/session/latency.h"

namespace lightstage::capture {

// With all lights: those that a single light's frame cannot be taken for.
bool is_bright(db::StepKind kind);

// One camera's frames on their way from the matcher to the store. Dark, full-on and tracking frames must be as bright as those
// measured before the pass; a matcher that slipped by one step gives such a step its neighbour's frame. The frames since the
// last witness wait for the next one, and are refused with it.
class Witness {
 public:
  // What the camera saw with no light and with all of them, by exposure: long ones may clip.
  explicit Witness(std::map<core::Nanoseconds, Brightness> brightness) : brightness_(std::move(brightness)) {}

  struct Verdict {
    std::vector<MatchedFrame> admitted;
    std::size_t refused = 0;
  };
  // Matched frames, in the order in which they were taken, with their steps' kinds.
  Verdict hear(std::vector<MatchedFrame> frames, const std::vector<db::Step>& steps);
  // What still waits.
  std::vector<MatchedFrame> rest();

 private:
  // Whether the frame is what its step must look like; true for steps of which that is not known.
  bool plausible(const MatchedFrame& frame, const db::Step& step) const;

  std::map<core::Nanoseconds, Brightness> brightness_;
  std::vector<MatchedFrame> waiting_;
  std::size_t waiting_bytes_ = 0;
};

// The steps to take, with a bright one at the end: where they end with another, the sequence's last bright step is shown once
// more, if it has one (what is stored already is not stored again).
std::vector<const db::Step*> with_witness(const Pass& pass, std::vector<const db::Step*> steps);

// Keeps those of a camera's matched frames that its witness admits, and counts the others as discarded.
void keep_admitted(Pass& pass, std::size_t camera, Witness& witness, std::vector<MatchedFrame> frames);
// At the end of steps with_witness(): what still waits is discarded, since the bright frame was not heard; it is kept where the
// sequence has none.
void keep_rest(Pass& pass, std::size_t camera, Witness& witness);

}  // namespace lightstage::capture
