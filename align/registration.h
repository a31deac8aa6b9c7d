// Bringing pictures taken under different lights to one pose where there are no tracking frames.
#pragma once

#include <functional>
#include <span>
#include <string>
#include <vector>

#include "align/flow.h"
#include "core/direction.h"

namespace lightstage::align {

// A shift and a turn about the picture's centre: what is at p in the common pose is at p + motion in the picture.
struct RigidMotion {
  double dx = 0, dy = 0;  // pixels, of the centre
  double radians = 0;     // from x towards y
  FlowField flow(int height, int width) const;
};

struct Registered {
  RigidMotion motion;
  // Correlation of the picture's local contrast with that of its neighbours, in place and moved; in [-1, 1].
  double correlation_before = 0, correlation_after = 0;
  double residual_before_px = 0, residual_after_px = 0;  // median length of the flow from what its neighbours predict
  std::string objection;                                 // why it could not be registered; empty where it was
};

// Registers every picture with what the pictures under the 8 nearest lights, brought to one pose, lead to expect, in rounds, by the enhanced
// correlation coefficient (Evangelidis and Psarakis 2008). What is compared is local contrast, the logarithm of the luminance free of its
// local mean and scaled to its local deviation, which changes little with the light: local to a 25th of the longer side in the first round, to a
// 100th (4 pixels at least) in the others. The pose is the mean of all. Weaker than tracking frames:
// rigid motion in the picture plane only, and shadows that wander with the light count as motion where contrast is poor; on pictures
// shrunk to 384 pixels, so exact to a share of that. Where registering does not lessen the median residual by a tenth, the pictures stay
// where they are, as fewer than 3 do. `picture(i)` gives the i-th picture, of one size, 1 or 3 channels; called several times, from several
// threads. The same on any number of threads. Throws BadInput for pictures of different sizes, below 32 pixels or not finite.
std::vector<Registered> register_pictures(const std::function<core::Image(std::size_t)>& picture,
                                          std::span<const core::Direction> lights);

}  // namespace lightstage::align
