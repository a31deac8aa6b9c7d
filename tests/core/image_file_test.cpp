#include "core/image_file.h"

#include <OpenImageIO/filesystem.h>
#include <OpenImageIO/imageio.h>

#include <algorithm>
#include <bit>
#include <catch2/catch.hpp>
#include <cmath>
#include <random>

#include "core/display.h"
#include "core/error.h"
#include "core/failure.h"
#include "core/file.h"
#include "core/full_disk.h"
#include "core/image_io/halves.h"
#include "support/support.h"

using namespace lightstage;
using core::Encoding;
using core::Image;
using core::ImageSize;
using core::PixelType;
namespace fs = std::filesystem;

namespace {

Image noise(int height, int width, int channels, unsigned seed = 1) {
  Image image(height, width, channels);
  std::mt19937 generator(seed);
  for (float& v : image.values()) v = float(generator() >> 8) * 0x1p-24f;
  return image;
}

double largest_difference(const Image& a, const Image& b) {
  REQUIRE(a.size() == b.size());
  double largest = 0;
  for (std::size_t i = 0; i < a.values().size(); ++i)
    largest = std::max(largest, std::abs(double(a.values()[i]) - b.values()[i]));
  return largest;
}

Image there_and_back(const Image& image, const fs::path& path, core::WriteOptions options = {}) {
  core::write_image(path, image, options);
  return core::read_image(path, {.encoding = options.encoding});
}

}  // namespace

TEST_CASE("float EXR and TIFF keep every bit, of 1 to 4 channels, crops and odd sizes") {
  const test::TemporaryFolder folder;
  for (const ImageSize size : {ImageSize{1, 1, 1}, {3, 101, 3}, {61, 2, 4}, {17, 19, 2}, {1, 16384, 3}}) {
    Image image = noise(size.height, size.width, size.channels);
    image.values()[0] = 1e5f;        // one hot pixel
    image.values().back() = 1e-42f;  // a denormal
    for (const char* name : {"a.exr", "a.tif"}) {
      INFO(name << " " << size.height << "x" << size.width << "x" << size.channels);
      CHECK(there_and_back(image, folder / name, {.pixel_type = PixelType::kFloat}) == image);
      CHECK(core::read_image_size(folder / name) == size);
    }
  }
  const Image image = noise(9, 9, 3);
  core::write_image(folder / "crop.exr", image.view().crop(2, 3, 4, 5), {.pixel_type = PixelType::kFloat});
  CHECK(core::read_image(folder / "crop.exr") == Image(image.view().crop(2, 3, 4, 5)));
}

TEST_CASE("EXR holds halves by default, clamped to what a half can hold") {
  const test::TemporaryFolder folder;
  const Image image = noise(31, 37, 3);
  const Image back = there_and_back(image, folder / "a.exr");
  for (std::size_t i = 0; i < image.values().size(); ++i)
    REQUIRE(std::abs(back.values()[i] - image.values()[i]) <= image.values()[i] * 0x1p-11f + 0x1p-25f);
  // What a half can hold comes back as it was.
  CHECK(there_and_back(back, folder / "b.exr") == back);

  Image extreme(1, 7, 1);
  const std::vector<float> values{65504, 65519, 1e5f, 3e38f, -1e5f, 0x1p-24f, 1e-30f};
  std::copy(values.begin(), values.end(), extreme.values().begin());
  const Image held = there_and_back(extreme, folder / "c.exr");
  const std::vector<float> expected{65504, 65504, 65504, 65504, -65504, 0x1p-24f, 0};
  CHECK(std::equal(expected.begin(), expected.end(), held.values().begin()));
}

TEST_CASE("halves come out the same by the processor's instructions and without, at every edge") {
  std::vector<float> values{0.0f,     -0.0f,    65504.0f,     65519.99f,       65520.0f, 1e30f,          -1e30f,
                            0x1p-24f, 0x1p-25f, 0x1.8p-25f,   0x1.000002p-25f, 1e-30f,   0x1.ffcp-15f,   0x1p-14f,
                            2049.0f,  2051.0f,  1 + 0x1p-11f, 1 + 0x1.8p-10f,  1e-42f,   0x1.ffdffep14f, 0.1f};
  std::mt19937 generator(3);
  for (int i = 0; i < 200'000; ++i) {  // all exponents
    const float v = std::bit_cast<float>(std::uint32_t(generator()));
    if (std::isfinite(v)) values.push_back(v);
  }
  std::vector<std::uint16_t> fast(values.size()), slow(values.size());
  for (const std::size_t count : {values.size(), std::size_t(0), std::size_t(1), std::size_t(7), std::size_t(9)}) {
    CHECK(core::image_io::to_halves(std::span(values).first(count), std::span(fast).first(count)));
    CHECK(core::image_io::to_halves_portably(std::span(values).first(count), std::span(slow).first(count)));
    CHECK(fast == slow);
  }
  for (const float strange : {std::nanf(""), INFINITY, -INFINITY})
    for (const std::size_t at : {std::size_t(0), std::size_t(5), std::size_t(16)}) {  // in registers and in the rest
      std::vector<float> bad(17, 1.0f);
      bad[at] = strange;
      CHECK_FALSE(core::image_io::to_halves(bad, std::span(fast).first(17)));
      CHECK_FALSE(core::image_io::to_halves_portably(bad, std::span(slow).first(17)));
    }
}

TEST_CASE("uncompressed EXR is what the library writes, byte for byte, and reads back as compressed EXR does") {
  const test::TemporaryFolder folder;
  for (const ImageSize size : {ImageSize{5, 7, 1}, {1, 1, 3}, {61, 33, 4}, {17, 19, 2}, {40, 50, 3}, {5, 7, 1}}) {
    INFO(size.height << "x" << size.width << "x" << size.channels);
    Image image = noise(size.height, size.width, size.channels);
    image.values()[0] = 1e9f;
    image.values().back() = -1e-6f;
    const std::vector<unsigned char> bytes = core::encode_image("a.exr", image, {.compressed = false});
    CHECK(bytes == core::encode_image("a.exr", image, {.compressed = false}));
    core::write_file_atomically(folder / "a.exr", {reinterpret_cast<const char*>(bytes.data()), bytes.size()});
    const Image back = core::read_image(folder / "a.exr");
    core::write_image(folder / "b.exr", image);
    CHECK(back == core::read_image(folder / "b.exr"));

    // The library's own, given what the compressed file held.
    std::vector<unsigned char> expected;
    OIIO::Filesystem::IOVecOutput sink(expected);
    const auto input = OIIO::ImageInput::open((folder / "a.exr").string());
    REQUIRE(input);
    OIIO::ImageSpec spec = input->spec();
    CHECK(spec.get_string_attribute("compression") == "none");
    CHECK(spec.format == OIIO::TypeDesc::HALF);
    const auto output = OIIO::ImageOutput::create("openexr");
    REQUIRE(output->set_ioproxy(&sink));
    REQUIRE(output->open("b.exr", spec));
    REQUIRE(output->write_image(OIIO::TypeDesc::FLOAT, back.values().data()));
    REQUIRE(output->close());
    CHECK(bytes == expected);
  }
  Image bad = noise(4, 5, 3);
  bad(2, 3, 1) = std::nanf("");
  CHECK(test::says(test::failure_of<core::BadInput>([&] { core::encode_image("a.exr", bad, {.compressed = false}); }),
                   "pixel x 3, y 2, channel 1"));
}

TEST_CASE("integer files are sRGB unless told otherwise, and keep 8 or 16 bits") {
  const test::TemporaryFolder folder;
  const Image image = noise(23, 29, 3);
  struct Case {
    const char* name;
    std::optional<PixelType> type;
    double step;
  };
  for (const Case& c : {Case{"a.png", std::nullopt, 1 / 255.0},
                        {"b.png", PixelType::kUint16, 1 / 65535.0},
                        {"a.tif", PixelType::kUint8, 1 / 255.0},
                        {"b.tiff", PixelType::kUint16, 1 / 65535.0},
                        {"a.ppm", std::nullopt, 1 / 255.0}}) {
    INFO(c.name);
    // sRGB's slope is at most 2.28 going back to light; linear keeps to half a step.
    CHECK(largest_difference(there_and_back(image, folder / c.name, {.pixel_type = c.type}), image) < 2.3 * c.step / 2);
    const core::WriteOptions linear{.pixel_type = c.type, .encoding = Encoding::kLinear};
    CHECK(largest_difference(there_and_back(image, folder / c.name, linear), image) <= 0.5001 * c.step);
    // Read as if it were sRGB, a linear file is darker.
    const Image misread = core::read_image(folder / c.name, {.encoding = Encoding::kSrgb});
    CHECK(misread.values()[5] ==
          Approx(core::srgb_decode(core::read_image(folder / c.name, {.encoding = Encoding::kLinear}).values()[5])));
  }
  core::write_image(folder / "grey.pgm", noise(5, 7, 1));
  CHECK(core::read_image_size(folder / "grey.pgm") == ImageSize{5, 7, 1});
}

TEST_CASE("integer files clamp to what they can hold") {
  const test::TemporaryFolder folder;
  Image image(1, 3, 1);
  image(0, 0) = -5;
  image(0, 1) = 1e5f;
  image(0, 2) = 0.5f;
  const Image back = there_and_back(image, folder / "a.png");
  CHECK(back(0, 0) == 0);
  CHECK(back(0, 1) == 1);
  CHECK(back(0, 2) == Approx(0.5).margin(0.005));
}

TEST_CASE("alpha is neither encoded nor multiplied into the colours") {
  const test::TemporaryFolder folder;
  for (const int channels : {2, 4})
    for (const char* name : {"a.png", "a.tif"}) {
      Image image = noise(4, 6, channels);
      image(1, 1, channels - 1) = 0;  // wholly transparent: its colour must survive
      const Image back = there_and_back(image, folder / name, {.pixel_type = PixelType::kUint16});
      INFO(name << " " << channels);
      CHECK(largest_difference(back, image) < 3e-5);
    }
}

TEST_CASE("JPEG and HDR keep pictures to their own precision") {
  const test::TemporaryFolder folder;
  Image smooth(64, 64, 3);
  for (int y = 0; y < 64; ++y)
    for (int x = 0; x < 64; ++x)
      for (int c = 0; c < 3; ++c) smooth(y, x, c) = float(x + y) / 128.0f;
  CHECK(largest_difference(there_and_back(smooth, folder / "a.jpg"), smooth) < 0.03);
  Image bright = noise(20, 30, 3);
  bright(3, 4, 0) = bright(3, 4, 1) = bright(3, 4, 2) = 1e5f;
  bright(5, 5, 1) = -1;
  const Image back = there_and_back(bright, folder / "a.hdr");
  CHECK(back(3, 4, 1) == Approx(1e5).epsilon(0.01));
  CHECK(back(5, 5, 1) == 0);
  CHECK(back(7, 8, 2) == Approx(bright(7, 8, 2)).margin(0.004));
}

TEST_CASE("equal images make equal files, whenever they are written") {
  const test::TemporaryFolder folder;
  const Image image = noise(40, 50, 3);
  for (const char* extension : {".exr", ".tif", ".png", ".jpg", ".hdr", ".ppm"}) {
    const fs::path path = folder / (std::string("a") + extension);
    core::write_image(path, image);
    const std::string bytes = core::read_text_file(path);
    INFO(extension);
    // A date would look like "2031:01:31 12:34:56".
    bool date = false;
    for (std::size_t at = 0; at + 19 <= bytes.size(); ++at)
      date |= bytes[at] == '2' && bytes[at + 4] == ':' && bytes[at + 7] == ':' && bytes[at + 10] == ' ' &&
              bytes[at + 13] == ':';
    CHECK_FALSE(date);
    core::write_image(folder / (std::string("b") + extension), image);
    CHECK(core::read_text_file(folder / (std::string("b") + extension)) == bytes);
  }
}

TEST_CASE("EXR names its primaries, so that other programs need not guess") {
  const test::TemporaryFolder folder;
  core::write_image(folder / "a.exr", noise(4, 4, 3));
  const std::string bytes = core::read_text_file(folder / "a.exr");
  CHECK(bytes.find("chromaticities") != std::string::npos);
  CHECK(bytes.find("lin_rec709_scene") != std::string::npos);
}

TEST_CASE("file names with spaces, question marks and other alphabets are names like any other") {
  const test::TemporaryFolder folder;
  const Image image = noise(4, 4, 3);
  for (const char* name : {"a b.exr", "a?b=1.png", "größe 図.tif", "UPPER.PNG", "a.b.c.hdr"}) {
    INFO(name);
    core::write_image(folder / name, image);
    CHECK(core::read_image(folder / name).size() == image.size());
  }
}

TEST_CASE("images that a format cannot hold are refused before anything is written") {
  const test::TemporaryFolder folder;
  const auto refused = [&](const char* name, const Image& image, core::WriteOptions options = {}) {
    const std::string message =
        test::failure_of<core::BadInput>([&] { core::write_image(folder / name, image, options); });
    CHECK(test::says(message, name));
    CHECK(fs::is_empty(folder.path()));
  };
  refused("a.gif", noise(2, 2, 3));
  refused("a", noise(2, 2, 3));
  refused("a.exr", Image(0, 4, 3));
  refused("a.exr", noise(2, 2, 5));
  refused("a.jpg", noise(2, 2, 4));
  refused("a.hdr", noise(2, 2, 1));
  refused("a.png", noise(2, 2, 3), {.pixel_type = PixelType::kHalf});
  refused("a.jpg", noise(2, 2, 3), {.pixel_type = PixelType::kUint16});
  refused("a.exr", noise(2, 2, 3), {.pixel_type = PixelType::kUint8});
  Image bad = noise(3, 2, 3);
  bad(2, 1, 0) = std::numeric_limits<float>::quiet_NaN();
  refused("a.exr", bad);
  const std::string message =
      test::failure_of<core::BadInput>([&] { core::write_image(folder / "none/a.exr", noise(2, 2, 3)); });
  CHECK(test::says(message, "none/a.exr", "no folder"));
}

TEST_CASE("a flipped bit in a PNG file is told of by us, before libpng meets it") {
  const test::TemporaryFolder folder;
  core::write_image(folder / "a.png", noise(40, 40, 3));
  std::string bytes = core::read_text_file(folder / "a.png");
  bytes[bytes.size() / 2] = char(bytes[bytes.size() / 2] ^ 16);
  core::write_file_atomically(folder / "b.png", bytes);
  const std::string message = test::failure_of<core::BadInput>([&] { core::read_image(folder / "b.png"); });
  CHECK(test::says(message, "b.png", "does not match its checksum"));
}

TEST_CASE("a full disk is noticed in every format, and the old picture stays") {
  const test::TemporaryFolder folder;
  const Image old = noise(2, 2, 3), image = noise(100, 100, 3, 2);
  for (const char* name : {"a.exr", "a.tif", "a.png", "a.jpg", "a.hdr", "a.ppm"}) {
    INFO(name);
    core::write_image(folder / name, old);
    const std::string before = core::read_text_file(folder / name);
    {
      const test::FullDisk full(4000);
      CHECK_THROWS_AS(core::write_image(folder / name, image), core::BadInput);
    }
    CHECK(core::read_text_file(folder / name) == before);
  }
  CHECK(std::distance(fs::directory_iterator(folder.path()), fs::directory_iterator()) == 6);
}
