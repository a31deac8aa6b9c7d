#include "capture/v4l2/raw_to_linear.h"

#include <cmath>
#include <opencv2/imgproc.hpp>

#include "core/error.h"
#include "core/parallel.h"

namespace lightstage::capture {

namespace {

constexpr std::size_t kRowGrain = 32;
// Codes of the R, G and B that YUYV can give (out of gamut they are far below 0), and how finely they are tabulated: linear
// between the entries, within 1e-6 of the signal.
constexpr int kLowestColour = -512, kHighestColour = 255, kColourSteps = 4;
constexpr int kColourEntries = (kHighestColour - kLowestColour) * kColourSteps + 1;
const std::vector<double> kDefaultLinearisation = CameraDevice{}.linearisation;

double decode_positive(ColourEncoding::Transfer transfer, double v) {
  switch (transfer) {
    case ColourEncoding::Transfer::kLinear:
      return v;
    case ColourEncoding::Transfer::kSrgb:
      return v <= 0.04045 ? v / 12.92 : std::pow((v + 0.055) / 1.055, 2.4);
    case ColourEncoding::Transfer::kRec709:
      return v < 0.081 ? v / 4.5 : std::pow((v + 0.099) / 1.099, 1 / 0.45);
  }
  return v;
}

// OpenCV names a mosaic after the pixels (1, 1) and (1, 2).
int opencv_conversion(BayerOrder order) {
  switch (order) {
    case BayerOrder::kRggb:
      return cv::COLOR_BayerBG2RGB_EA;
    case BayerOrder::kGrbg:
      return cv::COLOR_BayerGB2RGB_EA;
    case BayerOrder::kGbrg:
      return cv::COLOR_BayerGR2RGB_EA;
    case BayerOrder::kBggr:
      return cv::COLOR_BayerRG2RGB_EA;
  }
  return 0;
}

template <class Row>
void for_rows(int height, const Row& row) {
  core::parallel_for(static_cast<std::size_t>(height), kRowGrain, [&](std::size_t first, std::size_t last) {
    for (std::size_t y = first; y < last; ++y) row(static_cast<int>(y));
  });
}

}  // namespace

double decode(ColourEncoding::Transfer transfer, double encoded) {
  return std::copysign(decode_positive(transfer, std::abs(encoded)), encoded);
}

RawToLinear::RawToLinear(const std::string& camera, const PixelFormat& format, const CameraDevice& device,
                         const ColourEncoding& encoding)
    : format_(format), black_level_(device.black_level), encoding_(encoding) {
  const auto fail = [&](const std::string& problem) {
    throw core::BadInput("camera '" + camera + "': " + problem + "; correct the stage file");
  };
  const int top = format.top_code();
  const std::string format_name = fourcc_text(format.fourcc);
  if (!(black_level_ >= 0 && black_level_ < top)) {
    fail("the black level of format " + format_name + " must be from 0 to below " + std::to_string(top));
  }
  const bool by_format = device.linearisation.empty() || device.linearisation == kDefaultLinearisation;
  if (!by_format) {
    polynomial_ = device.linearisation;
  } else if (format.raw_channels() == 1) {
    polynomial_ = {1};
  }

  double before = signal(-1);
  for (int code = 0; code <= top; ++code) {
    const double here = signal(code);
    if (!std::isfinite(here) || !(here > before)) {
      fail("its linearisation does not rise at code " + std::to_string(code) + " of format " + format_name);
    }
    signal_of_code_.push_back(static_cast<float>(here));
    before = here;
  }
  if (format.layout == PixelLayout::kYuyv) {
    for (int i = 0; i < kColourEntries; ++i) {
      colour_signal_.push_back(static_cast<float>(signal(kLowestColour + double(i) / kColourSteps)));
    }
  }
  if (!format.bayer) return;
  const double lowest = signal(0);
  const int full = 65535 / top * top;  // whole steps between the codes of a linear sensor
  demosaic_black_ = lowest;
  demosaic_step_ = (signal(top) - lowest) / full;
  for (int code = 0; code <= top; ++code) {
    demosaic_code_.push_back(static_cast<std::uint16_t>(std::lround((signal(code) - lowest) / demosaic_step_)));
  }
}

double RawToLinear::signal(double code) const {
  const double s = (code - black_level_) / (format_.top_code() - black_level_);
  if (polynomial_.empty()) return decode(encoding_.transfer, s);
  double sum = 0;
  for (auto c = polynomial_.rbegin(); c != polynomial_.rend(); ++c) sum = (sum + *c) * std::abs(s);
  return std::copysign(sum, s);
}

core::Image RawToLinear::image(const RawPicture& picture, double radiance_per_signal) const {
  if (format_.bayer) return demosaic(picture, radiance_per_signal);
  if (format_.layout == PixelLayout::kYuyv) return from_yuyv(picture, radiance_per_signal);
  return look_up(picture, radiance_per_signal);
}

core::Image RawToLinear::look_up(const RawPicture& picture, double radiance_per_signal) const {
  core::Image image(picture.height, picture.width, picture.channels);
  const auto scale = static_cast<float>(radiance_per_signal);
  const int values = picture.width * picture.channels;
  for_rows(picture.height, [&](int y) {
    const std::uint16_t* const in = picture.row(y);
    float* const out = image.pixel(y, 0);
    for (int i = 0; i < values; ++i) out[i] = signal_of_code_[in[i]] * scale;
  });
  return image;
}

core::Image RawToLinear::from_yuyv(const RawPicture& picture, double radiance_per_signal) const {
  const bool is_709 = encoding_.matrix == ColourEncoding::Matrix::kRec709;
  const float kr = is_709 ? 0.2126f : 0.299f, kb = is_709 ? 0.0722f : 0.114f, kg = 1 - kr - kb;
  const float black = encoding_.full_range ? 0 : 16;
  const float luma_scale = encoding_.full_range ? 1 : 255.0f / 219;
  const float chroma_scale = encoding_.full_range ? 1 : 255.0f / 224;
  const float red_of_cr = 2 * (1 - kr) * chroma_scale, blue_of_cb = 2 * (1 - kb) * chroma_scale;
  const auto scale = static_cast<float>(radiance_per_signal);
  core::Image image(picture.height, picture.width, 3);
  for_rows(picture.height, [&](int y) {
    const std::uint16_t* in = picture.row(y);
    float* out = image.pixel(y, 0);
    for (int x = 0; x < picture.width; ++x, in += 3, out += 3) {
      const float luma = (static_cast<float>(in[0]) - black) * luma_scale;
      const float red = (static_cast<float>(in[2]) - 128) * red_of_cr;
      const float blue = (static_cast<float>(in[1]) - 128) * blue_of_cb;
      out[0] = colour_signal(luma + red) * scale;
      out[1] = colour_signal(luma - (kr * red + kb * blue) / kg) * scale;
      out[2] = colour_signal(luma + blue) * scale;
    }
  });
  return image;
}

float RawToLinear::colour_signal(float code) const {
  const float place = std::clamp((code - kLowestColour) * kColourSteps, 0.0f, float(kColourEntries - 1));
  const int entry = std::min(static_cast<int>(place), kColourEntries - 2);
  const float low = colour_signal_[static_cast<std::size_t>(entry)];
  const float high = colour_signal_[static_cast<std::size_t>(entry) + 1];
  return low + (place - static_cast<float>(entry)) * (high - low);
}

core::Image RawToLinear::demosaic(const RawPicture& picture, double radiance_per_signal) const {
  cv::Mat mosaic(picture.height, picture.width, CV_16UC1), colours;
  for_rows(picture.height, [&](int y) {
    const std::uint16_t* const in = picture.row(y);
    auto* const out = mosaic.ptr<std::uint16_t>(y);
    for (int x = 0; x < picture.width; ++x) out[x] = demosaic_code_[in[x]];
  });
  cv::demosaicing(mosaic, colours, opencv_conversion(*format_.bayer), 3);
  core::Image image(picture.height, picture.width, 3);
  const auto step = static_cast<float>(demosaic_step_ * radiance_per_signal);
  const auto black = static_cast<float>(demosaic_black_ * radiance_per_signal);
  for_rows(picture.height, [&](int y) {
    const auto* const in = colours.ptr<std::uint16_t>(y);
    float* const out = image.pixel(y, 0);
    for (int i = 0; i < 3 * picture.width; ++i) out[i] = black + static_cast<float>(in[i]) * step;
  });
  return image;
}

}  // namespace lightstage::capture
