// How highlights move from one light to the next, and pictures moved along.
#pragma once

#include "core/image.h"

namespace lightstage::model {

// Optical flow (dx, dy in pixels, two channels) that takes what is at p in `from` to p + flow(p) in `to`: dense inverse search (Kroeger et
// al. 2016, "Fast optical flow using dense inverse search") on display-encoded brightness, values of `white` and more being white. It counts only as far as
// it explains the difference of the two pictures, and fades to none where it does not: highlights that have no counterpart are blended.
// None for pictures below 16 pixels a side. The same on any number of threads.
core::Image highlight_flow(core::ImageView from, core::ImageView to, double white);

// The picture with every pixel moved by its displacement (two channels): bilinear splatting, of several pixels that come to lie in one place the
// mean. Pixels drawn apart by up to half as far again leave no hole; what is left behind is 0. Continuous in the displacement; none is no change.
core::Image moved(core::ImageView picture, core::ImageView displacement);

}  // namespace lightstage::model
