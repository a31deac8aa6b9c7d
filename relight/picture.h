// Pictures for people: EXR with the light, PNG for the eye.
#pragma once

#include <filesystem>

#include "core/image.h"

namespace lightstage::relight {

struct WrittenPicture {
  std::filesystem::path exr, png;
};

// Writes `path` (.exr) with the linear values in half floats, and beside it a PNG of the same name: the image times 2^stops, clipped to
// [0, 1], sRGB-encoded. Throws UsageError for another extension.
WrittenPicture write_picture(const std::filesystem::path& path, core::ImageView linear, double stops);

// The stops that bring the 99.5th percentile of the masked values to 1 (0 for a black image).
double auto_exposure_stops(core::ImageView linear, core::ImageView mask);

}  // namespace lightstage::relight
