// Pictures for people: EXR with the light, PNG for the eye.
#pragma once

#include <filesystem>

#include "core/image.h"

namespace lightstage::relight {

struct WrittenPicture {
  std::filesystem::path exr, png;
};

// Writes `path` (.exr) with the linear values in half floats, and beside it a PNG of the same name: the image
// times 2^stops, clipped to [0, 1], sRGB-encoded, 8 bits. Throws UsageError for another extension, and as
// core::write_image.
WrittenPicture write_picture(const std::filesystem::path& path, core::ImageView linear, double stops);

// The stops that bring the 99.5th percentile of the masked values to 1, within +-100 (0 for a black image).
// An empty mask means everywhere. Throws BadInput for a mask of another size or without a pixel inside, and for values that are not finite.
double auto_exposure_stops(core::ImageView linear, core::ImageView mask);

}  // namespace lightstage::relight
