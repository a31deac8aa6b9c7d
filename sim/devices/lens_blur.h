// What a lens does to a point.
#pragma once

#include "core/image.h"

namespace lightstage::sim {

// Convolution with a Gaussian of standard deviation `sigma_px`; beyond the picture lies its nearest edge pixel. The sum of a spot away
// from the edge is kept. A sigma of 0 copies. Values must not be NaN; infinite ones spread. O(pixels sigma_px).
core::Image lens_blur(core::ImageView picture, double sigma_px);

}  // namespace lightstage::sim
