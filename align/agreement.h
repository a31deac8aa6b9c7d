// Which tracking frames cannot be aligned: the subject moved too far, blinked, changed its expression, or was hidden.
#pragma once

#include <span>
#include <string>
#include <vector>

#include "align/flow.h"

namespace lightstage::align {

// How one tracking frame agrees with the key frame, once warped to its pose.
struct Agreement {
  double motion_px = 0;  // median length of the flow over the subject
  double residual = 0;   // as align::residual
  double believed = 1;   // share of the subject where the flow's confidence is not 0
  core::Image
      difference;  // root mean square difference of display-encoded values by cells, one channel; 0 where the subject is not, or
  // where the cell holds more of its outline than of what lies within
};

// Cells are squares of a 32nd of the longer side, at least 8 pixels, so that an eye covers one at least; of a cell counts what lies half a
// cell or more within the outline of the subject, where turning hides and uncovers. Pictures, flow and confidence of
// equal sizes; `mask` as align::residual takes it. Throws BadInput when sizes differ.
Agreement agreement_of(core::ImageView key, core::ImageView picture, const FlowField& flow, core::ImageView confidence,
                       core::ImageView mask);

// Why a key frame cannot serve, in words; empty when it can: "is black", "shows nothing to follow: it is even", or "is saturated over ... % of
// the subject" (more than half; `saturation` is the value at which the sensor clips, 0 where it is not known).
std::string key_objection(core::ImageView key, core::ImageView mask, double saturation);

// The farthest that motion is undone: this, or a 64th of the longer side where that is more.
constexpr double kFarthestMotionPx = 32;

// Why a tracking frame is not to be used, in words, in the order of `frames`; empty for those that agree:
// - "moved ...": farther than can be undone;
// - "cannot be followed": not even half of the subject is found there and back;
// - "changed in places, ...": cells differ more than 4 times as much as they mostly do, which is how blinks and expressions show;
// - "does not resemble the key frame": more than a quarter of the cells do, or the whole by more than 3 times without any cell that does.
// - "does not resemble the key frame" too, however many there are, where it differs by more than 0.3 on the whole.
// Differences below a just visible one (0.04 overall, 0.1 in a cell) are never held against a frame, nor are frames judged by others when
// there are fewer than 3. `longer_side` of the pictures in pixels.
std::vector<std::string> objections(std::span<const Agreement> frames, int longer_side);

}  // namespace lightstage::align
