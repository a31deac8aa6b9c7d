// Pictures for people: EXR with the light, PNG for the eye.
#pragma once

#include <filesystem>
#include <functional>

#include "core/image.h"

namespace lightstage::relight {

struct WrittenPicture {
  std::filesystem::path exr, png;
};

// The names: that of the EXR and of the PNG beside it.
WrittenPicture picture_files(const std::filesystem::path& exr);

// Writes `path` (.exr) with the linear values in half floats, and before it has its name, beside it, a PNG of the same name: the image
// times 2^stops, clipped to [0, 1], sRGB-encoded, 8 bits. Readers see whole files only. `finished`, if any, is called
// with the EXR's temporary name when its bytes are final, before the PNG is written; neither appears when that throws.
// Throws UsageError for another extension, and as core::write_image.
WrittenPicture write_picture(const std::filesystem::path& path, core::ImageView linear, double stops,
                             const std::function<void(const std::filesystem::path& exr)>& finished = {});

// The stops that bring the 99.5th percentile of the masked values to 1, within +-100 (0 for a black image).
// An empty mask means everywhere. Throws BadInput for a mask of another size or without a pixel inside, and for values that are not finite.
double auto_exposure_stops(core::ImageView linear, core::ImageView mask);

}  // namespace lightstage::relight
