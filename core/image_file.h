// Image files through OpenImageIO: PNG, JPEG, TIFF, PGM/PPM, OpenEXR, Radiance HDR.
#pragma once

#include <cstddef>
#include <filesystem>
#include <optional>
#include <vector>

#include "core/image.h"

namespace lightstage::core {

// How stored numbers relate to light. kAuto: float files (EXR, HDR, float TIFF) are linear, integer files
// sRGB-encoded.
enum class Encoding { kAuto, kLinear, kSrgb };

struct ReadOptions {
  Encoding encoding = Encoding::kAuto;
  // Files whose header claims more are refused before anything is allocated.
  std::size_t max_values = std::size_t(1) << 30;
};

// Reads 1- to 4-channel images into linear float32 (integers scaled to [0, 1]). Throws BadInput naming the
// file when it is missing, truncated, damaged, of too many channels or too large, or holds NaN or infinity
// (with pixel and value). Alpha (a second or fourth channel) is taken as stored: neither decoded nor
// multiplied into the colours.
Image read_image(const std::filesystem::path& path, const ReadOptions& options = {});

// Size from the header alone. Throws as read_image.
ImageSize read_image_size(const std::filesystem::path& path);

enum class PixelType { kUint8, kUint16, kHalf, kFloat };

struct WriteOptions {
  // By default: half for EXR, float for HDR and TIFF, 8 bits otherwise.
  std::optional<PixelType> pixel_type;
  // What the file holds. kAuto as for reading: linear for EXR, HDR and TIFF of float pixels, sRGB otherwise.
  // Values are clamped to [0, 1] for integer files, to +-65504 for half, and to >= 0 for HDR, which has no
  // sign.
  Encoding encoding = Encoding::kAuto;
  // False, for EXR of linear halves: the pixels as they are, in a hundredth of the time, in some three times the space. Other files are
  // written as ever.
  bool compressed = true;
};

// Writes so that a reader sees the old file or the whole new one (temporary file, fsync, rename). Metadata is
// fresh. Equal images give equal bytes: no time stamp is written. EXR is zip-compressed and names its colour
// space. Throws BadInput when the folder does not exist, the extension is not known, the format cannot hold
// the channels or pixel type (JPEG, PGM/PPM: 1 or 3 channels; HDR: 3), a value is not finite, or the disk is
// full.
void write_image(const std::filesystem::path& path, ImageView image, const WriteOptions& options = {});

// The bytes that write_image would write to that path. Throws as write_image, but touches no file.
std::vector<unsigned char> encode_image(const std::filesystem::path& path, ImageView image,
                                        const WriteOptions& options = {});

// Checks that every value is finite; throws BadInput naming `what`, the pixel (x, y, channel) and the value.
void require_finite(ImageView image, const std::string& what);

}  // namespace lightstage::core
