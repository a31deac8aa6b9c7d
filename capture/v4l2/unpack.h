// From the bytes of a driver's buffer to the numbers that the sensor gave.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "capture/v4l2/pixel_format.h"

namespace lightstage::capture {

// How a picture lies in a buffer.
struct BufferLayout {
  PixelFormat format;
  int width = 0, height = 0;
  std::size_t row_stride = 0;  // bytes from one row's start to the next

  // Up to the end of the last row; padding behind that may be missing.
  std::size_t picture_bytes() const;
};

// Values row by row without gaps, PixelFormat::raw_channels() of them a pixel: mosaic and grey one, RGB three, YUYV three
// (Y, Cb, Cr; both pixels of a pair have the pair's Cb and Cr).
struct RawPicture {
  int width = 0, height = 0, channels = 0;
  std::vector<std::uint16_t> values;

  std::uint16_t* row(int y) { return values.data() + row_start(y); }
  const std::uint16_t* row(int y) const { return values.data() + row_start(y); }

 private:
  std::size_t row_start(int y) const { return std::size_t(y) * std::size_t(width) * std::size_t(channels); }
};

// Fills `picture`, whose memory is used again where it is large enough. Values above the format's top code (a driver that
// does not keep to the format) count as the top code. Bytes that are missing at the end count as 0.
void unpack(std::span<const std::byte> buffer, const BufferLayout& layout, RawPicture& picture);

}  // namespace lightstage::capture
