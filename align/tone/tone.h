// Pictures as flow, masks and residuals look at them: luminance, scaled and display-encoded.
#pragma once

#include "core/image.h"

namespace lightstage::align {

// The 99th percentile of the luminance, by nearest rank: the value that becomes 1. 1 for pictures that are black or negative there, so
// that nothing is ever divided by 0.
double white_level(core::ImageView luminance);

// core::display_encode(luminance / white), one channel, not clipped.
core::Image encoded_luminance(core::ImageView luminance, double white);

}  // namespace lightstage::align
