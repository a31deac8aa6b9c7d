// The image file formats this project reads and writes, and what each of them can hold.
#pragma once

#include <filesystem>
#include <string_view>
#include <vector>

#include "core/image_file.h"

namespace lightstage::core::image_io {

struct Format {
  const char* plugin;                        // OpenImageIO's name for it
  std::vector<std::string_view> extensions;  // lower case
  std::vector<PixelType> pixel_types;        // that it can be written with; the default first
  std::vector<int> channel_counts;           // that it can be written with
};

// The format of a file by its extension. Throws BadInput naming the file and the extensions known.
const Format& format_of(const std::filesystem::path& path);

}  // namespace lightstage::core::image_io
