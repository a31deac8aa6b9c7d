#include "capture/v4l2/raw_to_linear.h"

#include <catch2/catch.hpp>
#include <random>

#include "core/display.h"
#include "core/error.h"

using namespace lightstage;
using namespace lightstage::capture;
using Catch::Matchers::Contains;

namespace {

const PixelFormat& format_named(const std::string& text) {
  static PixelFormat format;
  format = find_pixel_format(parse_fourcc(text).value()).value();
  return format;
}

CameraDevice device(double black_level, std::vector<double> linearisation = {1}) {
  CameraDevice result;
  result.black_level = black_level;
  result.linearisation = std::move(linearisation);
  return result;
}

RawToLinear converter(const std::string& format, const CameraDevice& spec, const ColourEncoding& encoding = {}) {
  return RawToLinear("left", format_named(format), spec, encoding);
}

RawPicture picture(int width, int height, int channels) {
  RawPicture raw;
  raw.width = width;
  raw.height = height;
  raw.channels = channels;
  raw.values.resize(std::size_t(width * height * channels));
  return raw;
}

RawPicture row_of(std::vector<std::uint16_t> values, int channels = 1) {
  RawPicture raw = picture(static_cast<int>(values.size()) / channels, 1, channels);
  raw.values = std::move(values);
  return raw;
}

// Which colour the pixel sees, written out.
int colour_at(BayerOrder order, int y, int x) {
  const char* const rows = order == BayerOrder::kRggb   ? "RGGB"
                           : order == BayerOrder::kGrbg ? "GRBG"
                           : order == BayerOrder::kGbrg ? "GBRG"
                                                        : "BGGR";
  const char c = rows[y % 2 * 2 + x % 2];
  return c == 'R' ? 0 : c == 'G' ? 1 : 2;
}

}  // namespace

TEST_CASE("grey codes become radiance: black is 0, the top code is the saturation, noise below black stays", "[v4l2]") {
  const RawToLinear to_linear = converter("Y12", device(255));
  const double radiance_per_signal = 1 / (25 * 0.02);
  const core::Image image = to_linear.image(row_of({255, 4095, 2175, 0}), radiance_per_signal);
  CHECK(image.channels() == 1);
  CHECK(image(0, 0) == 0);
  CHECK(image(0, 1) == Approx(2));
  CHECK(image(0, 1) == static_cast<float>(to_linear.top_signal() * radiance_per_signal));
  CHECK(image(0, 2) == Approx(1));
  CHECK(image(0, 3) == Approx(-2 * 255.0 / 3840));
}

TEST_CASE("the whole range of each depth is used", "[v4l2]") {
  for (const auto& [name, top] : std::vector<std::pair<std::string, int>>{
           {"GREY", 255}, {"Y10", 1023}, {"Y10P", 1023}, {"Y12", 4095}, {"Y16", 65535}, {"Y16-BE", 65535}}) {
    const RawToLinear to_linear = converter(name, device(0));
    std::vector<std::uint16_t> codes;
    for (int code = 0; code <= top; ++code) codes.push_back(static_cast<std::uint16_t>(code));
    const core::Image image = to_linear.image(row_of(codes), 3);
    bool right = true;
    for (int code = 0; code <= top; ++code) right = right && std::abs(image(0, code) - 3.0 * code / top) < 1e-6;
    CHECK(right);
  }
}

TEST_CASE("a linearisation undoes the sensor's curve", "[v4l2]") {
  // A sensor that answers sqrt(light): the square gives the light back.
  const RawToLinear to_linear = converter("Y16", device(1000, {0, 1}));
  std::vector<std::uint16_t> codes;
  for (int i = 0; i <= 100; ++i) {
    codes.push_back(static_cast<std::uint16_t>(std::lround(1000 + 64535 * std::sqrt(i / 100.0))));
  }
  const core::Image image = to_linear.image(row_of(codes), 1);
  for (int i = 0; i <= 100; ++i) CHECK(image(0, i) == Approx(i / 100.0).margin(2e-5));
  // Noise about black: as far below as above.
  const core::Image noise = to_linear.image(row_of({900, 1100}), 1);
  CHECK(noise(0, 0) == -noise(0, 1));
  CHECK(noise(0, 1) > 0);
}

TEST_CASE("a flat colour behind each mosaic comes back, in each order and depth", "[v4l2]") {
  for (const PixelFormat& format : pixel_formats()) {
    if (!format.bayer) continue;
    INFO(fourcc_text(format.fourcc));
    const double black = (1 << format.bits) / 16;
    const RawToLinear to_linear("left", format, device(black), {});
    const double codes[3] = {black + 0.8 * (format.top_code() - black), black + 0.5 * (format.top_code() - black),
                             black + 0.1 * (format.top_code() - black)};
    for (const auto& [width, height] : {std::pair{12, 10}, {13, 9}, {4, 4}, {5, 7}}) {
      RawPicture raw = picture(width, height, 1);
      for (int y = 0; y < height; ++y) {
        for (int x = 0; x < width; ++x) {
          raw.row(y)[x] = static_cast<std::uint16_t>(std::lround(codes[colour_at(*format.bayer, y, x)]));
        }
      }
      const core::Image image = to_linear.image(raw, 2);
      REQUIRE(image.size() == core::ImageSize{height, width, 3});
      double worst = 0;
      for (int y = 0; y < height; ++y) {
        for (int x = 0; x < width; ++x) {
          for (int c = 0; c < 3; ++c) {
            const double truth = 2 * (std::lround(codes[c]) - black) / (format.top_code() - black);
            worst = std::max(worst, std::abs(image(y, x, c) - truth));
          }
        }
      }
      CHECK(worst < 1e-6);
    }
  }
}

TEST_CASE("a mosaic keeps its own values where it measured them, and no value beyond them", "[v4l2]") {
  std::mt19937_64 random(4);
  const RawToLinear to_linear = converter("RG12", device(200, {0.5, 0.5}));
  RawPicture raw = picture(31, 22, 1);
  for (std::uint16_t& code : raw.values) code = static_cast<std::uint16_t>(random() % 4096);
  const core::Image image = to_linear.image(raw, 1);
  double worst = 0;
  for (int y = 1; y < raw.height - 1; ++y) {
    for (int x = 1; x < raw.width - 1; ++x) {
      const double s = (raw.row(y)[x] - 200) / 3895.0;
      const double truth = 0.5 * s + 0.5 * s * std::abs(s);
      worst = std::max(worst, std::abs(image(y, x, colour_at(BayerOrder::kRggb, y, x)) - truth));
    }
  }
  CHECK(worst < 1.0 / 65535);
  const auto [least, most] = std::minmax_element(image.values().begin(), image.values().end());
  CHECK(*most <= to_linear.top_signal() * (1 + 1e-6));
  CHECK(*least >= -0.03);
}

TEST_CASE("green follows an edge, it is not averaged across it", "[v4l2]") {
  // Left half dark, right half bright, all grey: along a vertical edge nothing bleeds into the column beside it.
  const RawToLinear to_linear = converter("RGGB", device(0));
  RawPicture raw = picture(20, 20, 1);
  for (int y = 0; y < 20; ++y) {
    for (int x = 0; x < 20; ++x) raw.row(y)[x] = x < 10 ? 20 : 200;
  }
  const core::Image image = to_linear.image(raw, 255);
  for (int y = 2; y < 18; ++y) {
    CHECK(image(y, 9, 1) == Approx(20).margin(1e-3));
    CHECK(image(y, 10, 1) == Approx(200).margin(1e-3));
  }
}

TEST_CASE("YUYV is decoded by matrix and range, then by its transfer function", "[v4l2]") {
  using Transfer = ColourEncoding::Transfer;
  using Matrix = ColourEncoding::Matrix;
  struct Colour {
    ColourEncoding encoding;
    std::vector<std::uint16_t> yuv;
    float r, g, b;  // encoded
  };
  // The corners of 75 % colour bars are tabulated; primaries at full level follow from the definitions.
  const std::vector<Colour> colours = {
      {{Transfer::kSrgb, Matrix::kRec601, false}, {16, 128, 128}, 0, 0, 0},
      {{Transfer::kSrgb, Matrix::kRec601, false}, {235, 128, 128}, 1, 1, 1},
      {{Transfer::kSrgb, Matrix::kRec601, false}, {81, 90, 240}, 1, 0, 0},
      {{Transfer::kSrgb, Matrix::kRec601, false}, {145, 54, 34}, 0, 1, 0},
      {{Transfer::kSrgb, Matrix::kRec601, false}, {41, 240, 110}, 0, 0, 1},
      {{Transfer::kSrgb, Matrix::kRec709, false}, {63, 102, 240}, 1, 0, 0},
      {{Transfer::kSrgb, Matrix::kRec601, true}, {76, 85, 255}, 1, 0, 0},
      {{Transfer::kSrgb, Matrix::kRec601, false}, {126, 128, 128}, 110 / 219.f, 110 / 219.f, 110 / 219.f},
  };
  for (const Colour& colour : colours) {
    const RawToLinear to_linear = converter("YUYV", device(0), colour.encoding);
    const core::Image image = to_linear.image(row_of(colour.yuv, 3), 5);
    INFO(colour.yuv[0] << " " << colour.yuv[1] << " " << colour.yuv[2]);
    CHECK(image(0, 0, 0) == Approx(5 * core::srgb_decode(colour.r)).margin(0.06));
    CHECK(image(0, 0, 1) == Approx(5 * core::srgb_decode(colour.g)).margin(0.06));
    CHECK(image(0, 0, 2) == Approx(5 * core::srgb_decode(colour.b)).margin(0.06));
    CHECK(to_linear.top_signal() == 1);
  }
}

TEST_CASE("every YUYV triple is what the formulas give", "[v4l2]") {
  std::mt19937_64 random(5);
  RawPicture raw = picture(500, 40, 3);
  for (std::uint16_t& code : raw.values) code = static_cast<std::uint16_t>(random() % 256);
  for (const double black : {0.0, 7.0}) {
    for (const bool full_range : {false, true}) {
      const ColourEncoding encoding{ColourEncoding::Transfer::kSrgb, ColourEncoding::Matrix::kRec601, full_range};
      const core::Image image = converter("YUYV", device(black), encoding).image(raw, 1);
      double worst = 0;
      for (int y = 0; y < raw.height; ++y) {
        for (int x = 0; x < raw.width; ++x) {
          const std::uint16_t* const in = raw.row(y) + 3 * x;
          const double luma = full_range ? in[0] : (in[0] - 16) * 255 / 219.0;
          const double chroma = full_range ? 1 : 255 / 224.0;
          const double cb = (in[1] - 128) * chroma, cr = (in[2] - 128) * chroma;
          // ITU-R BT.601: R = Y + 1.402 Cr, G = Y - (0.299 1.402 Cr + 0.114 1.772 Cb) / 0.587, B = Y + 1.772 Cb.
          const double codes[3] = {luma + 1.402 * cr, luma - (0.299 * 1.402 * cr + 0.114 * 1.772 * cb) / 0.587,
                                   luma + 1.772 * cb};
          for (int c = 0; c < 3; ++c) {
            const double s = (std::min(codes[c], 255.0) - black) / (255 - black);
            worst = std::max(worst, std::abs(image(y, x, c) - decode(ColourEncoding::Transfer::kSrgb, s)));
          }
        }
      }
      CHECK(worst < 2e-6);
    }
  }
}

TEST_CASE("what is brighter than YUYV's white is not above the saturation", "[v4l2]") {
  const RawToLinear to_linear = converter("YUYV", device(0));
  const core::Image image = to_linear.image(row_of({255, 128, 128, 254, 255, 255}, 3), 1);
  for (const float value : image.values()) CHECK(value <= 1);
}

TEST_CASE("RGB24 is decoded as the driver says, or as the stage file says", "[v4l2]") {
  const std::vector<std::uint16_t> rgb{0, 128, 255};
  ColourEncoding encoding;
  encoding.transfer = ColourEncoding::Transfer::kSrgb;
  CHECK(converter("RGB3", device(0), encoding).image(row_of(rgb, 3), 1)(0, 0, 1) ==
        Approx(core::srgb_decode(128 / 255.f)));
  encoding.transfer = ColourEncoding::Transfer::kRec709;
  CHECK(converter("RGB3", device(0), encoding).image(row_of(rgb, 3), 1)(0, 0, 1) ==
        Approx(std::pow((128 / 255. + 0.099) / 1.099, 1 / 0.45)));
  encoding.transfer = ColourEncoding::Transfer::kLinear;
  CHECK(converter("RGB3", device(0), encoding).image(row_of(rgb, 3), 1)(0, 0, 1) == Approx(128 / 255.));
  encoding.transfer = ColourEncoding::Transfer::kSrgb;
  CHECK(converter("RGB3", device(0, {1, 0}), encoding).image(row_of(rgb, 3), 1)(0, 0, 1) == Approx(128 / 255.));
}

TEST_CASE("transfer functions agree with the project's own and are odd", "[v4l2]") {
  for (int i = 0; i <= 1000; ++i) {
    const double v = i / 1000.0;
    REQUIRE(decode(ColourEncoding::Transfer::kSrgb, v) ==
            Approx(core::srgb_decode(static_cast<float>(v))).margin(1e-6));
    REQUIRE(decode(ColourEncoding::Transfer::kRec709, -v) == -decode(ColourEncoding::Transfer::kRec709, v));
  }
}

TEST_CASE("a black level or linearisation that makes no sense is refused by name", "[v4l2]") {
  CHECK_THROWS_AS(converter("GREY", device(255)), core::BadInput);
  CHECK_THROWS_AS(converter("GREY", device(-1)), core::BadInput);
  CHECK_THROWS_AS(converter("GREY", device(std::nan(""))), core::BadInput);
  CHECK_THROWS_WITH(converter("GREY", device(0, {1, -1})), Contains("camera 'left'") && Contains("does not rise"));
  CHECK_THROWS_AS(converter("GREY", device(0, {0})), core::BadInput);
  CHECK_NOTHROW(converter("GREY", device(254)));
  CHECK_NOTHROW(converter("GREY", device(0, {})));
}
