#include "core/image_io/plain_exr.h"

#include <bit>
#include <cstdint>
#include <cstring>

#include "core/image_io/halves.h"

namespace lightstage::core::image_io {

namespace {

static_assert(std::endian::native == std::endian::little, "EXR files are little-endian, and are written from memory");

constexpr std::size_t kRowHead = 8;

std::size_t row_bytes(ImageSize size) {
  return 2 * std::size_t(size.width) * std::size_t(size.channels);
}

}  // namespace

std::size_t pixels_begin(std::span<const unsigned char> file, ImageSize size) {
  return file.size() - std::size_t(size.height) * (kRowHead + row_bytes(size));
}

std::vector<unsigned char> plain_exr(std::span<const unsigned char> header, ImageView image) {
  const std::size_t width = std::size_t(image.width()), channels = std::size_t(image.channels());
  const std::size_t row_size = row_bytes(image.size());
  std::vector<unsigned char> file;
  file.reserve(header.size() + std::size_t(image.height()) * (kRowHead + row_size));
  file.assign(header.begin(), header.end());
  std::vector<std::uint16_t> interleaved(width * channels), planes(width * channels);
  for (int y = 0; y < image.height(); ++y) {
    if (!to_halves({image.row(y), interleaved.size()}, interleaved)) return {};
    // R, G, B, A and Y, A: the alphabet runs against the order of the channels but for alpha, which comes first.
    const std::size_t colours = channels <= 2 ? 1 : 3, first = channels - colours;
    for (std::size_t c = 0; c < channels; ++c) {
      const std::size_t plane = c < colours ? first + colours - 1 - c : 0;
      std::uint16_t* const target = planes.data() + plane * width;
      for (std::size_t x = 0; x < width; ++x) target[x] = interleaved[x * channels + c];
    }
    const std::int32_t head[2] = {y, static_cast<std::int32_t>(row_size)};
    const auto* const head_bytes = reinterpret_cast<const unsigned char*>(head);
    const auto* const row = reinterpret_cast<const unsigned char*>((channels == 1 ? interleaved : planes).data());
    file.insert(file.end(), head_bytes, head_bytes + kRowHead);
    file.insert(file.end(), row, row + row_size);
  }
  return file;
}

}  // namespace lightstage::core::image_io
