// The subject's motion through a pass, from the tracking frames.
#pragma once

#include <optional>
#include <vector>

#include "align/flow.h"
#include "core/clock.h"

namespace lightstage::align {

// How a pixel moves from one tracking frame to the next; both reach every tracking frame's flow exactly.
enum class Between {
  kLinear,      // exact for constant velocity
  kCatmullRom,  // cubic, its velocity at a tracking frame that of the parabola through it and its neighbours (at the first and last, of the
  // nearest three): exact for constant acceleration too, at whatever times tracking frames were taken (Catmull and Rom 1974)
};

// Flow from the key frame's pose to the pose at each tracking frame, and in between. Before the first and after the last tracking frame
// the subject stands still.
class MotionTrack {
 public:
  explicit MotionTrack(Between between = Between::kLinear) : between_(between) {}

  // In any order; times must differ. `confidence` (one channel; empty: 1 everywhere) is how far the flow can be believed (align/flow.h).
  // Throws BadInput for a flow or confidence of another size, values that are not finite, or a time given twice.
  void add(core::Nanoseconds time, FlowField flow, core::Image confidence = {});
  std::size_t size() const { return knots_.size(); }
  // Throws BadInput when empty.
  FlowField at(core::Nanoseconds time) const;
  // Linear in time from one tracking frame to the next. Throws BadInput when empty.
  core::Image confidence_at(core::Nanoseconds time) const;

  // The last time that tracking frames which come later in time cannot change the motion before; nothing when there is none. For streaming.
  std::optional<core::Nanoseconds> settled_until() const;
  // Drops tracking frames that the motion from `time` on does not need, so that a long pass takes no more memory than a short one.
  void forget_before(core::Nanoseconds time);

 private:
  struct Knot {
    core::Nanoseconds time;
    FlowField flow;
    core::Image confidence;
  };
  // The first knot that is not before the time.
  std::size_t knot_from(core::Nanoseconds time) const;

  Between between_;
  std::vector<Knot> knots_;  // by time
};

// Median length of the flow over the mask (one channel, inside where > 0.5; empty: everywhere), in pixels.
double median_motion_px(const FlowField& flow, core::ImageView mask);

// Whether what flow there is, is what noise makes of a subject that stands still: less than 0.02 pixels on the median and 0.08 for 95 %, over
// the mask as above. Such a subject is best left as it is.
bool stands_still(const FlowField& flow, core::ImageView mask);

// Root mean square difference of display-encoded values over the mask, after scaling both by the first one's 99th percentile: how
// well a picture, once warped, agrees with the reference under the same light.
double residual(core::ImageView reference, core::ImageView warped, core::ImageView mask);

}  // namespace lightstage::align
