// What is said to the image viewer tev, byte by byte.
#pragma once

#include <string>

#include "core/image.h"

namespace lightstage::capture {

// The packets of tev's network protocol (its README, "Over the Network"; fields in the order of the helpers
// that it points to): a 32-bit length that counts itself, a byte for the operation, the payload; numbers
// little-endian, strings ended by a zero byte. tev never answers.

// CreateImage (4): grab focus (byte), name, width, height, channel count (int32), channel names. An image of that name is
// replaced by a black one. Focus is never taken: an operator who looks at another picture keeps looking at it.
std::string tev_create_packet(const std::string& name, core::ImageSize size);

// UpdateImageV3 (6): grab focus, name, channel count, channel names, x, y, width, height (int32), an offset and a
// stride in floats for each channel (int64), then the float32 pixels as they lie in the image: interleaved.
std::string tev_update_packet(const std::string& name, const core::Image& image);

}  // namespace lightstage::capture
