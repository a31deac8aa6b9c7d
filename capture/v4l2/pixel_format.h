// The pixel formats that pictures can be measured in, and why the others are refused.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>

namespace lightstage::capture {

enum class PixelLayout {
  k8,         // one byte a value
  k16Little,  // two bytes a value, the low one first; values fill the low bits
  k16Big,     // two bytes a value, the high one first
  kMipi10,  // 5 bytes for 4 values: four times the upper 8 bits, then the lower 2 bits of each, the first in the lowest bits
  kMipi12,  // 3 bytes for 2 values: twice the upper 8 bits, then the lower 4 bits of each, the first in the lower half
  kRgb24,   // three bytes a pixel: R, G, B
  kYuyv,    // four bytes for 2 pixels: Y0, Cb, Y1, Cr; an odd width ends with half a pair
};

// Colours of the pixels (0, 0), (0, 1), (1, 0) and (1, 1) of a mosaic.
enum class BayerOrder { kRggb, kGrbg, kGbrg, kBggr };

struct PixelFormat {
  std::uint32_t fourcc = 0;
  PixelLayout layout = PixelLayout::k8;
  int bits = 8;
  std::optional<BayerOrder> bayer;  // empty: every pixel has all its channels

  int raw_channels() const { return layout == PixelLayout::kRgb24 || layout == PixelLayout::kYuyv ? 3 : 1; }
  int image_channels() const { return bayer ? 3 : raw_channels(); }
  int top_code() const { return (1 << bits) - 1; }
  // What a row of pixels occupies; rows may lie further apart.
  std::size_t row_bytes(int width) const;
};

// All of them, as linux/videodev2.h lists them.
std::span<const PixelFormat> pixel_formats();

// Nothing for a format that is not measured in.
std::optional<PixelFormat> find_pixel_format(std::uint32_t fourcc);
// One line why not; empty when it can be.
std::string refusal(std::uint32_t fourcc);

// As people write it: four characters without spaces at the end ("Y10"), and "-BE" behind the big-endian variant. Bytes that
// are not printable become '?'.
std::string fourcc_text(std::uint32_t fourcc);
// The other way; spaces at the end may be there. Nothing for a text of another length.
std::optional<std::uint32_t> parse_fourcc(std::string_view text);

}  // namespace lightstage::capture
