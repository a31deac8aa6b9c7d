// Which pixels show the subject, from a picture under full light against a dark background.
#pragma once

#include "core/image.h"

namespace lightstage::align {

// A background brighter than this share of the subject's radiance is not told from a dark part of the subject.
constexpr double kBrightestBackground = 0.1;

// One channel, 1 inside and 0 outside. Otsu's threshold on the display-encoded luminance tells subject from background; the mask
// begins at a quarter of the way from the background's median to the subject's, not below the background's noise; the
// largest connected parts are kept and their holes filled. A picture without contrast, or with a background that is not dark, gives a
// mask of all ones. Throws BadInput for values that are not finite.
core::Image subject_mask(core::ImageView full_on);

}  // namespace lightstage::align
