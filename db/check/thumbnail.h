// Pictures reduced to what comparing them needs.
#pragma once

#include <cstddef>

#include "core/image.h"

namespace lightstage::db {

// Side lengths, in pixels, of the longer side at most.
constexpr int kShapeSide = 24;
constexpr int kDamageSide = 48;
constexpr int kDetailSide = 12;

// Of a thumbnail: with fewer, pictures are too small to be compared by what is in them.
constexpr std::size_t kLeastPixelsToCompare = 64;

// Means over boxes, linear, channels kept.
core::Image shrink(core::ImageView linear, int longest_side);
// The same as luminance, one channel.
core::Image thumbnail(core::ImageView linear, int longest_side);

// How much rows differ from the rows above and below: the root mean square, in boxes, of the second
// difference down the columns of the display-encoded luminance. Constant or smooth pictures give 0, torn
// (interlaced) ones shine.
core::Image row_detail(core::ImageView linear, int longest_side);

}  // namespace lightstage::db
