#include "capture/v4l2/pixel_format.h"

#include <linux/videodev2.h>

#include <algorithm>
#include <array>

namespace lightstage::capture {

namespace {

using enum BayerOrder;
using enum PixelLayout;

constexpr std::uint32_t kBigEndian = 1u << 31;

constexpr PixelFormat kFormats[] = {
    {V4L2_PIX_FMT_GREY, k8, 8, {}},
    {V4L2_PIX_FMT_Y10, k16Little, 10, {}},
    {V4L2_PIX_FMT_Y10P, kMipi10, 10, {}},
    {V4L2_PIX_FMT_Y12, k16Little, 12, {}},
    {V4L2_PIX_FMT_Y16, k16Little, 16, {}},
    {V4L2_PIX_FMT_Y16_BE, k16Big, 16, {}},
    {V4L2_PIX_FMT_SRGGB8, k8, 8, kRggb},
    {V4L2_PIX_FMT_SGRBG8, k8, 8, kGrbg},
    {V4L2_PIX_FMT_SGBRG8, k8, 8, kGbrg},
    {V4L2_PIX_FMT_SBGGR8, k8, 8, kBggr},
    {V4L2_PIX_FMT_SRGGB10, k16Little, 10, kRggb},
    {V4L2_PIX_FMT_SGRBG10, k16Little, 10, kGrbg},
    {V4L2_PIX_FMT_SGBRG10, k16Little, 10, kGbrg},
    {V4L2_PIX_FMT_SBGGR10, k16Little, 10, kBggr},
    {V4L2_PIX_FMT_SRGGB10P, kMipi10, 10, kRggb},
    {V4L2_PIX_FMT_SGRBG10P, kMipi10, 10, kGrbg},
    {V4L2_PIX_FMT_SGBRG10P, kMipi10, 10, kGbrg},
    {V4L2_PIX_FMT_SBGGR10P, kMipi10, 10, kBggr},
    {V4L2_PIX_FMT_SRGGB12, k16Little, 12, kRggb},
    {V4L2_PIX_FMT_SGRBG12, k16Little, 12, kGrbg},
    {V4L2_PIX_FMT_SGBRG12, k16Little, 12, kGbrg},
    {V4L2_PIX_FMT_SBGGR12, k16Little, 12, kBggr},
    {V4L2_PIX_FMT_SRGGB12P, kMipi12, 12, kRggb},
    {V4L2_PIX_FMT_SGRBG12P, kMipi12, 12, kGrbg},
    {V4L2_PIX_FMT_SGBRG12P, kMipi12, 12, kGbrg},
    {V4L2_PIX_FMT_SBGGR12P, kMipi12, 12, kBggr},
    {V4L2_PIX_FMT_SRGGB16, k16Little, 16, kRggb},
    {V4L2_PIX_FMT_SGRBG16, k16Little, 16, kGrbg},
    {V4L2_PIX_FMT_SGBRG16, k16Little, 16, kGbrg},
    {V4L2_PIX_FMT_SBGGR16, k16Little, 16, kBggr},
    {V4L2_PIX_FMT_RGB24, kRgb24, 8, {}},
    {V4L2_PIX_FMT_YUYV, kYuyv, 8, {}},
};

constexpr std::uint32_t kLossy[] = {
    V4L2_PIX_FMT_MJPEG, V4L2_PIX_FMT_JPEG, V4L2_PIX_FMT_H264, V4L2_PIX_FMT_HEVC,
    V4L2_PIX_FMT_MPEG,  V4L2_PIX_FMT_VP8,  V4L2_PIX_FMT_VP9,  V4L2_PIX_FMT_DV,
};

}  // namespace

std::size_t PixelFormat::row_bytes(int width) const {
  const auto w = static_cast<std::size_t>(width);
  switch (layout) {
    case k8:
      return w;
    case k16Little:
    case k16Big:
      return 2 * w;
    case kMipi10:
      return (w + 3) / 4 * 5;
    case kMipi12:
      return (w + 1) / 2 * 3;
    case kRgb24:
      return 3 * w;
    case kYuyv:
      return (w + 1) / 2 * 4;
  }
  return 0;
}

std::span<const PixelFormat> pixel_formats() {
  return kFormats;
}

std::optional<PixelFormat> find_pixel_format(std::uint32_t fourcc) {
  const auto* const found = std::find_if(std::begin(kFormats), std::end(kFormats),
                                         [fourcc](const PixelFormat& format) { return format.fourcc == fourcc; });
  if (found == std::end(kFormats)) return std::nullopt;
  return *found;
}

std::string refusal(std::uint32_t fourcc) {
  if (find_pixel_format(fourcc)) return {};
  if (std::find(std::begin(kLossy), std::end(kLossy), fourcc) != std::end(kLossy)) {
    return "compressed with loss: what a pixel says depends on its neighbours, so that no light can be measured in it";
  }
  return "not one of the raw formats that can be measured in";
}

std::string fourcc_text(std::uint32_t fourcc) {
  std::string text;
  for (int i = 0; i < 4; ++i) {
    const auto c = static_cast<char>((fourcc & ~kBigEndian) >> (8 * i) & 0xff);
    text += c >= ' ' && c <= '~' ? c : '?';
  }
  text.erase(text.find_last_not_of(' ') + 1);
  return fourcc & kBigEndian ? text + "-BE" : text;
}

std::optional<std::uint32_t> parse_fourcc(std::string_view text) {
  constexpr std::string_view kSuffix = "-BE";
  const bool big_endian = text.size() > kSuffix.size() && text.ends_with(kSuffix);
  if (big_endian) text.remove_suffix(kSuffix.size());
  if (text.empty() || text.size() > 4) return std::nullopt;
  std::uint32_t fourcc = big_endian ? kBigEndian : 0;
  for (std::size_t i = 0; i < 4; ++i) {
    const char c = i < text.size() ? text[i] : ' ';
    if (c < ' ' || c > '~') return std::nullopt;
    fourcc |= std::uint32_t(c) << (8 * i);
  }
  return fourcc;
}

}  // namespace lightstage::capture
