#include "capture/v4l2/unpack.h"

#include <algorithm>
#include <cstring>

#include "core/parallel.h"

namespace lightstage::capture {

namespace {

constexpr std::size_t kRowGrain = 64;

using Bytes = const std::uint8_t*;

void unpack_8(Bytes in, std::size_t count, std::uint16_t* out) {
  for (std::size_t i = 0; i < count; ++i) out[i] = in[i];
}

// Written so that the compiler makes wide loads of it; the machine's own byte order does not matter.
void unpack_16_little(Bytes in, std::size_t count, std::uint16_t top, std::uint16_t* out) {
  for (std::size_t i = 0; i < count; ++i) {
    out[i] = std::min(static_cast<std::uint16_t>(in[2 * i] | in[2 * i + 1] << 8), top);
  }
}

void unpack_16_big(Bytes in, std::size_t count, std::uint16_t top, std::uint16_t* out) {
  for (std::size_t i = 0; i < count; ++i) {
    out[i] = std::min(static_cast<std::uint16_t>(in[2 * i] << 8 | in[2 * i + 1]), top);
  }
}

void unpack_mipi_10(Bytes in, std::size_t count, std::uint16_t* out) {
  for (; count >= 4; count -= 4, in += 5, out += 4) {
    const unsigned low = in[4];
    out[0] = static_cast<std::uint16_t>(in[0] << 2 | (low & 3));
    out[1] = static_cast<std::uint16_t>(in[1] << 2 | (low >> 2 & 3));
    out[2] = static_cast<std::uint16_t>(in[2] << 2 | (low >> 4 & 3));
    out[3] = static_cast<std::uint16_t>(in[3] << 2 | low >> 6);
  }
  for (std::size_t i = 0; i < count; ++i) {
    out[i] = static_cast<std::uint16_t>(in[i] << 2 | (in[4] >> (2 * i) & 3));
  }
}

void unpack_mipi_12(Bytes in, std::size_t count, std::uint16_t* out) {
  for (; count >= 2; count -= 2, in += 3, out += 2) {
    out[0] = static_cast<std::uint16_t>(in[0] << 4 | (in[2] & 15));
    out[1] = static_cast<std::uint16_t>(in[1] << 4 | in[2] >> 4);
  }
  if (count == 1) out[0] = static_cast<std::uint16_t>(in[0] << 4 | (in[2] & 15));
}

void unpack_yuyv(Bytes in, std::size_t width, std::uint16_t* out) {
  for (; width >= 2; width -= 2, in += 4, out += 6) {
    const std::uint16_t cb = in[1], cr = in[3];
    out[0] = in[0], out[1] = cb, out[2] = cr;
    out[3] = in[2], out[4] = cb, out[5] = cr;
  }
  if (width == 1) out[0] = in[0], out[1] = in[1], out[2] = in[3];
}

void unpack_row(Bytes in, const PixelFormat& format, int width, std::uint16_t* out) {
  const auto w = static_cast<std::size_t>(width);
  const auto top = static_cast<std::uint16_t>(format.top_code());
  switch (format.layout) {
    case PixelLayout::k8:
      return unpack_8(in, w, out);
    case PixelLayout::k16Little:
      return unpack_16_little(in, w, top, out);
    case PixelLayout::k16Big:
      return unpack_16_big(in, w, top, out);
    case PixelLayout::kMipi10:
      return unpack_mipi_10(in, w, out);
    case PixelLayout::kMipi12:
      return unpack_mipi_12(in, w, out);
    case PixelLayout::kRgb24:
      return unpack_8(in, 3 * w, out);
    case PixelLayout::kYuyv:
      return unpack_yuyv(in, w, out);
  }
}

}  // namespace

std::size_t BufferLayout::picture_bytes() const {
  return row_stride * static_cast<std::size_t>(height - 1) + format.row_bytes(width);
}

void unpack(std::span<const std::byte> buffer, const BufferLayout& layout, RawPicture& picture) {
  picture.width = layout.width;
  picture.height = layout.height;
  picture.channels = layout.format.raw_channels();
  picture.values.resize(std::size_t(layout.width) * std::size_t(layout.height) * std::size_t(picture.channels));
  const std::size_t row_bytes = layout.format.row_bytes(layout.width);
  core::parallel_for(static_cast<std::size_t>(layout.height), kRowGrain, [&](std::size_t first, std::size_t last) {
    std::vector<std::uint8_t> cut_row;
    for (std::size_t y = first; y < last; ++y) {
      const std::size_t start = std::min(y * layout.row_stride, buffer.size());
      const std::size_t present = std::min(row_bytes, buffer.size() - start);
      const auto* in = reinterpret_cast<Bytes>(buffer.data() + start);
      if (present < row_bytes) {
        cut_row.assign(row_bytes, 0);
        std::copy_n(in, present, cut_row.begin());
        in = cut_row.data();
      }
      unpack_row(in, layout.format, layout.width, picture.row(static_cast<int>(y)));
    }
  });
}

}  // namespace lightstage::capture
