// EXR files of half floats without compression, made as fast as memory is written.
#pragma once

#include <span>
#include <vector>

#include "core/image.h"

namespace lightstage::core::image_io {

// `header` is all of such a file that comes before its pixels (magic number, attributes, offset table): it is the same for every picture of a size, so it is taken from
// what the library writes for one (pixels_begin). What follows, written here, is for each row its number, its length in bytes, and its values,
// channel after channel in the alphabetical order of their names (OpenEXR File Layout, "Scan line blocks"). Rows of Y; A, Y; B, G, R or A, B, G, R.
// Returns nothing when a value is not finite; values are clamped to +-65504.
std::vector<unsigned char> plain_exr(std::span<const unsigned char> header, ImageView image);

// Where the pixels begin in a file of that size.
std::size_t pixels_begin(std::span<const unsigned char> file, ImageSize size);

}  // namespace lightstage::core::image_io
