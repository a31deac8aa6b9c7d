// The subject's motion through a pass, from the tracking frames.
#pragma once

#include <vector>

#include "align/flow.h"
#include "core/clock.h"

namespace lightstage::align {

// Flow from the key frame's pose to the pose at each tracking frame; in between, every pixel moves linearly in time from one
// tracking frame to the next, reaching both exactly. Before the first and after the last it stands still.
class MotionTrack {
 public:
  // In any order; times must differ. Throws BadInput for a flow of another size or a time given twice.
  void add(core::Nanoseconds time, FlowField flow);
  std::size_t size() const { return knots_.size(); }
  // Throws BadInput when empty.
  FlowField at(core::Nanoseconds time) const;

 private:
  struct Knot {
    core::Nanoseconds time;
    FlowField flow;
  };
  std::vector<Knot> knots_;  // by time
};

// Median length of the flow over the mask (one channel, inside where > 0.5; empty: everywhere), in pixels.
double median_motion_px(const FlowField& flow, core::ImageView mask);

// Root mean square difference of display-encoded values over the mask, after scaling both by the first one's 99th percentile: how
// well a picture, once warped, agrees with the reference under the same light.
double residual(core::ImageView reference, core::ImageView warped, core::ImageView mask);

}  // namespace lightstage::align
