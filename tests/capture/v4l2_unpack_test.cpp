#include "capture/v4l2/unpack.h"

#include <catch2/catch.hpp>
#include <random>

#include "capture/v4l2/pixel_format.h"

using namespace lightstage::capture;

namespace {

// One value, straight from the description of the layout in pixel_format.h; missing bytes are 0.
int reference(const std::vector<std::byte>& buffer, const BufferLayout& layout, int y, int x, int channel) {
  const auto byte = [&](std::size_t offset) {
    const std::size_t i = std::size_t(y) * layout.row_stride + offset;
    return i < buffer.size() ? std::to_integer<int>(buffer[i]) : 0;
  };
  const auto column = static_cast<std::size_t>(x);
  const int top = (1 << layout.format.bits) - 1;
  switch (layout.format.layout) {
    case PixelLayout::k8:
      return byte(column);
    case PixelLayout::k16Little:
      return std::min(top, byte(2 * column) + 256 * byte(2 * column + 1));
    case PixelLayout::k16Big:
      return std::min(top, 256 * byte(2 * column) + byte(2 * column + 1));
    case PixelLayout::kMipi10: {
      const int low = byte(column / 4 * 5 + 4) / (1 << 2 * (x % 4)) % 4;
      return 4 * byte(column / 4 * 5 + column % 4) + low;
    }
    case PixelLayout::kMipi12: {
      const int low = byte(column / 2 * 3 + 2) / (x % 2 == 0 ? 1 : 16) % 16;
      return 16 * byte(column / 2 * 3 + column % 2) + low;
    }
    case PixelLayout::kRgb24:
      return byte(3 * column + static_cast<std::size_t>(channel));
    case PixelLayout::kYuyv: {
      const std::size_t pair = column / 2 * 4;
      return byte(channel == 0 ? pair + 2 * (column % 2) : channel == 1 ? pair + 1 : pair + 3);
    }
  }
  return -1;
}

std::vector<std::byte> random_bytes(std::size_t count, std::mt19937_64& random) {
  std::vector<std::byte> bytes(count);
  for (std::byte& b : bytes) b = static_cast<std::byte>(random());
  return bytes;
}

void compare(const std::vector<std::byte>& buffer, const BufferLayout& layout, RawPicture& picture) {
  INFO(fourcc_text(layout.format.fourcc) << " " << layout.width << "x" << layout.height << ", stride "
                                         << layout.row_stride << ", " << buffer.size() << " bytes");
  unpack(buffer, layout, picture);
  REQUIRE(picture.width == layout.width);
  REQUIRE(picture.height == layout.height);
  REQUIRE(picture.channels == layout.format.raw_channels());
  REQUIRE(picture.values.size() == std::size_t(layout.width * layout.height * picture.channels));
  bool same = true;
  for (int y = 0; y < layout.height; ++y) {
    for (int x = 0; x < layout.width; ++x) {
      for (int c = 0; c < picture.channels; ++c) {
        same = same && picture.row(y)[x * picture.channels + c] == reference(buffer, layout, y, x, c);
      }
    }
  }
  REQUIRE(same);
}

}  // namespace

TEST_CASE("every format unpacks as its plain description says, at every width and stride", "[v4l2]") {
  std::mt19937_64 random(1);
  RawPicture picture;  // used again and again, as the camera does
  for (const PixelFormat& format : pixel_formats()) {
    for (const int width : {1, 2, 3, 4, 5, 6, 7, 8, 15, 16, 17, 33, 64, 101}) {
      for (const int height : {1, 2, 5, 130}) {
        const std::size_t padding = random() % 3 == 0 ? 0 : random() % 40;
        const BufferLayout layout{format, width, height, format.row_bytes(width) + padding};
        compare(random_bytes(layout.picture_bytes() + random() % 2 * padding, random), layout, picture);
      }
    }
  }
}

TEST_CASE("a buffer cut short unpacks to what it holds, and 0 after", "[v4l2]") {
  std::mt19937_64 random(2);
  RawPicture picture;
  for (const PixelFormat& format : pixel_formats()) {
    const BufferLayout layout{format, 7, 5, format.row_bytes(7) + 3};
    for (std::size_t size = 0; size <= layout.picture_bytes(); ++size) {
      compare(random_bytes(size, random), layout, picture);
    }
  }
}

TEST_CASE("a value above the format's top code counts as the top code", "[v4l2]") {
  const std::vector<std::byte> buffer{std::byte{0xff}, std::byte{0xff}, std::byte{0xff}, std::byte{0x03},
                                      std::byte{0x00}, std::byte{0x04}, std::byte{0xfe}, std::byte{0x03}};
  RawPicture picture;
  unpack(buffer, {*find_pixel_format(*parse_fourcc("Y10")), 4, 1, 8}, picture);
  CHECK(picture.values == std::vector<std::uint16_t>{1023, 1023, 1023, 1022});
}

TEST_CASE("pixel formats are named as people write them, and refused with a reason", "[v4l2]") {
  for (const PixelFormat& format : pixel_formats()) {
    CHECK(parse_fourcc(fourcc_text(format.fourcc)) == format.fourcc);
    CHECK(refusal(format.fourcc).empty());
  }
  CHECK(fourcc_text(*parse_fourcc("Y16 ")) == "Y16");
  CHECK(find_pixel_format(*parse_fourcc("Y16"))->layout == PixelLayout::k16Little);
  CHECK(find_pixel_format(*parse_fourcc("Y16-BE"))->layout == PixelLayout::k16Big);
  CHECK(find_pixel_format(*parse_fourcc("GREY"))->bits == 8);
  CHECK(find_pixel_format(*parse_fourcc("BA81"))->bayer == BayerOrder::kBggr);
  CHECK(find_pixel_format(*parse_fourcc("BA12"))->bayer == BayerOrder::kGrbg);
  CHECK_FALSE(parse_fourcc("").has_value());
  CHECK_FALSE(parse_fourcc("GREYS").has_value());
  CHECK_FALSE(parse_fourcc("Y1\n").has_value());
  CHECK(refusal(*parse_fourcc("MJPG")).find("compressed with loss") != std::string::npos);
  CHECK(refusal(*parse_fourcc("NV12")).find("not one of") != std::string::npos);
}
