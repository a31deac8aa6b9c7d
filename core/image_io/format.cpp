#include "core/image_io/format.h"

#include <algorithm>
#include <cctype>
#include <string>

#include "core/error.h"

namespace lightstage::core::image_io {

namespace {

const std::vector<Format>& formats() {
  using enum PixelType;
  static const std::vector<Format> all{
      {"png", {".png"}, {kUint8, kUint16}, {1, 2, 3, 4}},
      {"jpeg", {".jpg", ".jpeg"}, {kUint8}, {1, 3}},
      {"tiff", {".tif", ".tiff"}, {kFloat, kUint8, kUint16, kHalf}, {1, 2, 3, 4}},
      {"pnm", {".pgm", ".ppm"}, {kUint8}, {1, 3}},
      {"openexr", {".exr"}, {kHalf, kFloat}, {1, 2, 3, 4}},
      {"hdr", {".hdr"}, {kFloat}, {3}},
  };
  return all;
}

}  // namespace

const Format& format_of(const std::filesystem::path& path) {
  std::string extension = path.extension().string();
  std::transform(extension.begin(), extension.end(), extension.begin(),
                 [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  std::string known;
  for (const Format& format : formats())
    for (const std::string_view candidate : format.extensions) {
      if (candidate == extension) return format;
      known.append(" ").append(candidate);
    }
  throw BadInput(path.string() + ": not an image format this program knows; use one of" + known);
}

}  // namespace lightstage::core::image_io
