// Which pixels show the subject, from a picture under full light against a dark background.
#pragma once

#include "core/image.h"

namespace lightstage::align {

// One channel, 1 inside and 0 outside. Threshold between the background's and the subject's display-encoded luminance (Otsu, not below the
// background noise), the largest connected parts, holes filled. A picture without contrast gives a mask of all ones.
core::Image subject_mask(core::ImageView full_on);

}  // namespace lightstage::align
