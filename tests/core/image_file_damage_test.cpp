// Files that are damaged, lie about their size, or hold values that are no light.
#include <catch2/catch.hpp>
#include <cstring>
#include <limits>
#include <random>

#include "core/error.h"
#include "core/failure.h"
#include "core/file.h"
#include "core/image_file.h"
#include "support/support.h"

using namespace lightstage;
using core::Image;
using test::says;
namespace fs = std::filesystem;

namespace {

Image noise(int height, int width, int channels) {
  Image image(height, width, channels);
  std::mt19937 generator(3);
  for (float& v : image.values()) v = float(generator() >> 8) * 0x1p-24f;
  return image;
}

std::string refusal(const fs::path& path, const core::ReadOptions& options = {}) {
  return test::failure_of<core::BadInput>([&] { core::read_image(path, options); });
}

}  // namespace

TEST_CASE("a file cut short is refused by name wherever it is cut") {
  const test::TemporaryFolder folder;
  const Image image = noise(61, 83, 3);
  for (const char* extension : {".exr", ".png", ".jpg", ".tif", ".ppm", ".hdr"}) {
    const fs::path whole = folder / (std::string("whole") + extension), cut = folder / (std::string("cut") + extension);
    core::write_image(whole, image);
    const std::string bytes = core::read_text_file(whole);
    // JPEG decoders supply a missing end marker, and TIFF ends with its date: neither costs a pixel.
    const std::size_t harmless = std::string(extension) == ".jpg" ? 2 : std::string(extension) == ".tif" ? 20 : 0;
    for (std::size_t part = 0; part <= 16; ++part) {
      const std::size_t length = std::min(bytes.size() * part / 16, bytes.size() - harmless - 1);
      core::write_file_atomically(cut, bytes.substr(0, length));
      INFO(extension << " cut to " << length << " of " << bytes.size());
      CHECK(says(refusal(cut), cut.string()));
    }
  }
}

TEST_CASE("a file that is missing, a folder, or of another format than its name is refused by name") {
  const test::TemporaryFolder folder;
  CHECK(says(refusal(folder / "absent.exr"), (folder / "absent.exr").string(), "no such file"));
  fs::create_directory(folder / "d.png");
  CHECK(says(refusal(folder / "d.png"), "d.png", "not a regular file"));
  core::write_file_atomically(folder / "x.gif", "GIF89a");
  CHECK(says(refusal(folder / "x.gif"), "x.gif", ".exr"));
  core::write_image(folder / "a.exr", noise(4, 4, 3));
  for (const char* extension : {".png", ".jpg", ".tif", ".ppm", ".hdr"}) {
    const fs::path other = folder / (std::string("b") + extension);
    fs::copy_file(folder / "a.exr", other);
    CHECK(says(refusal(other), other.string()));
  }
  CHECK(says(test::failure_of<core::BadInput>([&] { core::read_image_size(folder / "absent.exr"); }), "absent.exr"));
}

TEST_CASE("NaN and infinity are found wherever they are") {
  const auto check = [](float bad, const char* text) {
    Image poisoned(4, 5, 3);
    poisoned(3, 2, 1) = bad;
    const std::string message = test::failure_of<core::BadInput>([&] { core::require_finite(poisoned, "x.exr"); });
    CHECK(says(message, "x.exr", "x 2, y 3, channel 1", text));
  };
  check(std::numeric_limits<float>::quiet_NaN(), "nan");
  check(std::numeric_limits<float>::infinity(), "inf");
  check(-std::numeric_limits<float>::infinity(), "-inf");
  CHECK_NOTHROW(core::require_finite(noise(3, 3, 3), "x"));
  CHECK_NOTHROW(core::require_finite(Image(), "x"));
}

TEST_CASE("a file with NaN in it is refused with file, pixel and value") {
  const test::TemporaryFolder folder;
  // Noise so short that zip cannot shrink it stands in the file as it is, where one value can be overwritten;
  // the writer would refuse it.
  Image image = noise(2, 3, 1);
  constexpr float kMarker = 0.12345678f;
  image(1, 2) = kMarker;
  const fs::path path = folder / "a.exr";
  core::write_image(path, image, {.pixel_type = core::PixelType::kFloat});
  std::string bytes = core::read_text_file(path);
  const auto bytes_of = [](float v) {
    std::string raw(sizeof v, '\0');
    std::memcpy(raw.data(), &v, sizeof v);
    return raw;
  };
  const std::size_t at = bytes.find(bytes_of(kMarker));
  REQUIRE(at != std::string::npos);
  bytes.replace(at, sizeof kMarker, bytes_of(std::numeric_limits<float>::quiet_NaN()));
  core::write_file_atomically(path, bytes);
  CHECK(says(refusal(path), path.string(), "x 2, y 1, channel 0", "nan"));
  bytes.replace(at, sizeof kMarker, bytes_of(-std::numeric_limits<float>::infinity()));
  core::write_file_atomically(path, bytes);
  CHECK(says(refusal(path), path.string(), "x 2, y 1, channel 0", "-inf"));
}

TEST_CASE("headers that claim more than the file can hold are refused before memory is taken") {
  const test::TemporaryFolder folder;
  core::write_file_atomically(folder / "huge.ppm", "P6\n30000 30000\n255\nabc");
  CHECK(says(refusal(folder / "huge.ppm"), "huge.ppm", "30000x30000", "allowed"));
  core::write_file_atomically(folder / "large.ppm", "P6\n15000 15000\n255\nabc");
  CHECK(says(refusal(folder / "large.ppm"), "large.ppm", "15000x15000", "cannot hold"));
  core::write_image(folder / "a.exr", noise(10, 10, 3));
  CHECK_NOTHROW(core::read_image(folder / "a.exr", {.max_values = 300}));
  CHECK(says(refusal(folder / "a.exr", {.max_values = 299}), "10x10x3", "299"));
  // A large black image is small on disk and must still be readable.
  core::write_image(folder / "black.png", Image(4000, 4000, 1));
  CHECK(core::read_image(folder / "black.png").height() == 4000);
}

TEST_CASE("an attribute of an EXR header that states another size than its type has is refused by name") {
  // The library would read what the type asks for and take the middle of a value for the next attribute, whatever that claims.
  const test::TemporaryFolder folder;
  const fs::path path = folder / "a.exr";
  core::write_image(path, noise(5, 7, 3));
  const std::string sound = core::read_text_file(path);
  const std::pair<std::string, std::string> attributes[] = {
      {"channels", "chlist"},       {"compression", "compression"}, {"dataWindow", "box2i"},
      {"displayWindow", "box2i"},   {"lineOrder", "lineOrder"},     {"pixelAspectRatio", "float"},
      {"screenWindowCenter", "v2f"}};
  for (const auto& [name, type] : attributes) {
    const std::string before = name + '\0' + type + '\0';
    const std::size_t at = sound.find(before);
    REQUIRE(at != std::string::npos);
    for (const int more : {-1, 1, 60}) {
      std::string bytes = sound;
      bytes[at + before.size()] = char(bytes[at + before.size()] + more);
      core::write_file_atomically(path, bytes);
      INFO(name << " by " << more);
      CHECK(says(refusal(path), path.string(), "'" + name + "'", "size"));
    }
  }
}

TEST_CASE("an HDR file that went through a text conversion is refused") {
  const fs::path path = test::real_data("broken/mojibake.hdr");
  if (path.empty()) SKIP_TEST("damaged HDR file not found");
  CHECK(says(refusal(path), path.string()));
}

TEST_CASE("real photographs are read: 16-bit PNG, JPEG, PGM with comments, EXR and HDR") {
  const fs::path root = test::real_data("README.md");
  if (root.empty()) SKIP_TEST("real photographs not found");
  const fs::path data = root.parent_path();
  CHECK(core::read_image_size(data / "broken/yaleB21_P00_Ambient.pgm") == core::ImageSize{480, 640, 1});
  CHECK(core::read_image(data / "broken/yaleB21_P00_Ambient.pgm").height() == 480);
  const Image ball = core::read_image(data / "diligent_ball16/001.png", {.encoding = core::Encoding::kLinear});
  CHECK(ball.size() == core::ImageSize{196, 212, 3});
  // 16 bits: some value is no multiple of 1/255.
  bool finer = false;
  for (const float v : ball.values()) finer |= std::abs(v * 255 - std::round(v * 255)) > 0.1f;
  CHECK(finer);
}
