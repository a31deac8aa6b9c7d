// From linear light to values for a screen, and back.
#pragma once

#include "core/image.h"

namespace lightstage::core {

// IEC 61966-2-1 transfer functions on [0, 1]; linear continuation below 0 and the power above 1.
float srgb_encode(float linear);
float srgb_decode(float encoded);

inline constexpr double kDisplayGamma = 2.2;

// The display encoding in which errors are judged and in which methods may blend: max(v, 0)^(1/2.2). Decoding
// is the power 2.2 of max(v, 0). Both are finite for all finite input.
float display_encode(float linear);
float display_decode(float encoded);
Image display_encode(ImageView linear);
Image display_decode(ImageView encoded);

// 2^stops * image: photographic exposure.
Image expose(ImageView image, double stops);

}  // namespace lightstage::core
