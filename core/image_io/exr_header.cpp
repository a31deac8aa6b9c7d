#include "core/image_io/exr_header.h"

#include <algorithm>
#include <array>
#include <fstream>
#include <string>
#include <string_view>
#include <vector>

#include "core/error.h"

namespace lightstage::core::image_io {

namespace fs = std::filesystem;

namespace {

constexpr std::uint32_t kMagic = 20000630, kMultiPart = 0x1000;
constexpr std::size_t kLongestName = 255;
// The library reads that many bytes of an attribute of these types whatever size stands before it, and takes what follows for the next attribute.
struct FixedSize {
  std::string_view type;
  std::size_t bytes;
};
// clang-format off
constexpr std::array<FixedSize, 24> kFixedSizes{{
    {"compression", 1}, {"deepImageState", 1}, {"envmap", 1}, {"lineOrder", 1},
    {"float", 4}, {"int", 4},
    {"double", 8}, {"rational", 8}, {"timecode", 8}, {"v2f", 8}, {"v2i", 8},
    {"tiledesc", 9},
    {"v3f", 12}, {"v3i", 12},
    {"box2f", 16}, {"box2i", 16}, {"v2d", 16},
    {"v3d", 24}, {"keycode", 28}, {"chromaticities", 32}, {"m33f", 36}, {"m44f", 64}, {"m33d", 72}, {"m44d", 128}}};
// clang-format on
constexpr std::uint64_t kLongestSide = 1 << 20, kLargestTile = 1 << 26, kAlwaysAllowed = 1 << 22;

class Header {
 public:
  Header(const fs::path& path, std::uint64_t max_pixels, std::uint64_t most_compression)
      : path_(path),
        file_(path, std::ios::binary | std::ios::ate),
        max_pixels_(max_pixels),
        most_compression_(most_compression) {
    size_ = std::uint64_t(std::max<std::streamoff>(0, file_.tellg()));
    file_.seekg(0);
  }

  void check() {
    if (number(take(4), 0) != kMagic) fail("is not an OpenEXR file, whatever its name says");
    const bool parts = (number(take(4), 0) & kMultiPart) != 0;
    while (check_part() && parts) {
    }
  }

 private:
  // False for the empty header that ends a list of parts.
  bool check_part() {
    bool any = false;
    for (std::string name = text(); !name.empty(); name = text()) {
      any = true;
      const std::string type = text();
      const std::uint64_t bytes = number(take(4), 0);
      if (bytes > size_ - at_) fail("its attribute '" + name + "' claims more than the file holds");
      check_attribute(type, take(bytes), name);
    }
    return any;
  }

  void check_attribute(const std::string& type, const std::vector<char>& value, const std::string& name) {
    const auto wrong_size = [&] { fail("its attribute '" + name + "' has not the size that its type has"); };
    const auto* const fixed = std::ranges::find(kFixedSizes, std::string_view(type), &FixedSize::type);
    if (fixed != kFixedSizes.end() && value.size() != fixed->bytes) wrong_size();
    if (name == "dataWindow" || name == "displayWindow") {
      if (type != "box2i") wrong_size();
      const auto side = [&](std::size_t first, std::size_t last) {
        return std::int64_t(std::int32_t(number(value, last))) - std::int32_t(number(value, first)) + 1;
      };
      check_size(side(0, 8), side(4, 12));
    } else if (type == "tiledesc") {
      const std::uint64_t width = number(value, 0), height = number(value, 4);
      if (width == 0 || height == 0 || width > kLargestTile / height) fail("its tiles are too large");
    } else if (type == "preview") {
      if (value.size() < 8) wrong_size();
      const std::uint64_t width = number(value, 0), height = number(value, 4);
      // The product of two 32-bit numbers fits 64 bits; four times it need not.
      if ((value.size() - 8) % 4 != 0 || width * height != (value.size() - 8) / 4) wrong_size();
    } else if (type == "chlist") {
      if (!ends_as_channels_do(value)) wrong_size();
    } else if (type == "stringvector") {
      for (std::size_t at = 0; at < value.size();) {
        if (value.size() - at < 4) wrong_size();
        const std::size_t length = number(value, at);
        if (length > value.size() - at - 4) wrong_size();
        at += 4 + length;
      }
    } else if (type == "idmanifest") {
      fail("holds a manifest of IDs, whose size nobody knows before memory is taken for it");
    }
  }

  // A list of channels ends with an empty name: names, each with a zero and 16 bytes after it, and one more zero.
  static bool ends_as_channels_do(const std::vector<char>& value) {
    constexpr std::ptrdiff_t kChannelBytes = 16;
    auto at = value.begin();
    while (at != value.end() && *at != '\0') {
      at = std::find(at, value.end(), '\0');
      if (value.end() - at < 1 + kChannelBytes) return false;
      at += 1 + kChannelBytes;
    }
    return at != value.end() && at + 1 == value.end();
  }

  void check_size(std::int64_t width, std::int64_t height) const {
    const std::string claim = "its header claims " + std::to_string(width) + "x" + std::to_string(height) + " pixels";
    if (width < 1 || height < 1) fail("not a two-dimensional image");
    const std::uint64_t pixels = std::uint64_t(width) * std::uint64_t(height);
    if (std::uint64_t(width) > kLongestSide || std::uint64_t(height) > kLongestSide || pixels > max_pixels_) {
      fail(claim + ", more than are allowed");
    }
    if (pixels > kAlwaysAllowed && pixels / most_compression_ > size_) {
      fail(claim + ", which a file of " + std::to_string(size_) + " bytes cannot hold");
    }
  }

  // Little-endian.
  static std::uint32_t number(const std::vector<char>& bytes, std::size_t at) {
    std::uint32_t value = 0;
    for (std::size_t i = 0; i < 4; ++i) value |= std::uint32_t(static_cast<unsigned char>(bytes[at + i])) << (8 * i);
    return value;
  }

  std::vector<char> take(std::size_t bytes) {
    std::vector<char> taken(bytes);
    if (!file_.read(taken.data(), std::streamsize(bytes))) fail("is cut short");
    at_ += bytes;
    return taken;
  }

  std::string text() {
    std::string text;
    for (char c = take(1)[0]; c != '\0'; c = take(1)[0]) {
      if (text.size() == kLongestName) fail("is damaged: a name in its header does not end");
      text += c;
    }
    return text;
  }

  [[noreturn]] void fail(const std::string& problem) const { throw BadInput(path_.string() + ": " + problem); }

  const fs::path& path_;
  std::ifstream file_;
  std::uint64_t size_ = 0, at_ = 0, max_pixels_, most_compression_;
};

}  // namespace

void check_exr_header(const fs::path& path, std::uint64_t max_values, std::uint64_t most_compression) {
  Header(path, max_values, most_compression).check();
}

}  // namespace lightstage::core::image_io
