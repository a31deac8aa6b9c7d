// FLIP, how much an observer sees who flips between two pictures (Andersson, Nilsson, Akenine-Moeller, Oskarsson, Astroem and Fairchild 2020, "FLIP: A
// Difference Evaluator for Alternating Images").
#pragma once

#include "core/image.h"

namespace lightstage::model {

// Pixels in one degree of sight that the publication takes: 0.7 m in front of a screen 0.7 m and 3840 pixels wide.
inline constexpr double kFlipPixelsPerDegree = 67.02064327658225;

// One channel, in [0, 1] at every pixel: 0 where nothing is seen to change, and nowhere else. Pictures are display-encoded (power 1/2.2), of
// equal size, of one channel or three (linear sRGB primaries, D65, once decoded); values beyond [0, 1] are clipped. Equal for (a, b) and
// (b, a). Beyond the border the outermost pixels are repeated. Throws BadInput for sizes that differ, for two or more than three channels,
// and for a distance that is not between 1 and 1000 pixels a degree. Takes about 200 bytes a pixel.
core::Image flip_map(core::ImageView a, core::ImageView b, double pixels_per_degree = kFlipPixelsPerDegree);

}  // namespace lightstage::model
