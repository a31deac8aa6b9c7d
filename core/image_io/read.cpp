#include <OpenImageIO/imageio.h>
#include <unistd.h>
#include <zlib.h>

#include <algorithm>
#include <bit>
#include <cctype>
#include <cmath>
#include <fstream>
#include <system_error>

#include "core/big_endian.h"
#include "core/display.h"
#include "core/error.h"
#include "core/image_file.h"
#include "core/image_io/exr_header.h"
#include "core/image_io/format.h"
#include "core/parallel.h"
#include "core/text.h"

namespace lightstage::core {

namespace fs = std::filesystem;

namespace {

// No compression of the formats we read makes files this much smaller than their pixels (DEFLATE reaches 1032
// to 1), so a header that claims more is false and must not make us allocate.
constexpr std::uint64_t kMostCompression = 4096;
constexpr std::size_t kAlwaysAllowedValues = std::size_t(1) << 22;

// A picture may take half of the machine's memory, which leaves the other half to what is done with it.
std::uint64_t most_bytes() {
  static const std::uint64_t physical =
      std::uint64_t(::sysconf(_SC_PHYS_PAGES)) * std::uint64_t(::sysconf(_SC_PAGESIZE));
  return physical / 2;
}

BadInput failure(const fs::path& path, const std::string& problem) {
  return BadInput(path.string() + ": " + problem);
}

// What the library says of a failure, as the end of a one-line message; it may say nothing. Lack of memory is no fault of the file: an import that leaves out
// damaged files must end by it.
std::string detail(const fs::path& path, const OIIO::ImageInput& input) {
  std::string text = input.geterror();
  if (text.find("bad_alloc") != std::string::npos) {
    throw Error(ErrorKind::kInternal, path.string() + ": there is not enough memory to read it");
  }
  std::replace(text.begin(), text.end(), '\n', ' ');
  const std::string_view trimmed = trim(text);
  return trimmed.empty() ? std::string() : ": " + std::string(trimmed);
}

struct OpenImage {
  std::unique_ptr<OIIO::ImageInput> input;
  OIIO::ImageSpec spec;
  ImageSize size;
};

void check_spec(const fs::path& path, const OIIO::ImageSpec& spec, std::size_t max_values) {
  if (spec.deep) throw failure(path, "deep images are not supported");
  if (spec.width < 1 || spec.height < 1 || spec.depth > 1) throw failure(path, "not a two-dimensional image");
  if (spec.nchannels < 1 || spec.nchannels > 4)
    throw failure(path, "has " + std::to_string(spec.nchannels) + " channels; 1 to 4 can be read");
  if (spec.x != spec.full_x || spec.y != spec.full_y || spec.width != spec.full_width ||
      spec.height != spec.full_height)
    throw failure(path, "its data window differs from its display window; write it uncropped");
  const std::uint64_t values = std::uint64_t(spec.width) * std::uint64_t(spec.height) * std::uint64_t(spec.nchannels);
  const std::string claim = "its header claims " + std::to_string(spec.width) + "x" + std::to_string(spec.height) +
                            "x" + std::to_string(spec.nchannels) + " values";
  if (values > max_values) throw failure(path, claim + ", more than the " + std::to_string(max_values) + " allowed");
  if (values * sizeof(float) > most_bytes()) {
    throw failure(path, claim + ", which take more than half of this machine's memory");
  }
  std::error_code error;
  const std::uintmax_t bytes = fs::file_size(path, error);
  if (!error && values > kAlwaysAllowedValues && values / kMostCompression > bytes)
    throw failure(path, claim + ", which a file of " + std::to_string(bytes) + " bytes cannot hold");
}

// Follows the chunks of a PNG file to its end chunk (ISO/IEC 15948, clause 5.3) and compares the checksums of those that a picture needs, because libpng prints to
// stderr when it meets the end of the file too early or a checksum that does not match. Damage that keeps its checksum is left to libpng.
void check_png_is_whole(const fs::path& path) {
  // Of the file that was opened: by its name there may be another one by now (a preview's next still).
  std::ifstream file(path, std::ios::binary | std::ios::ate);
  const auto size = static_cast<std::uintmax_t>(std::max<std::streamoff>(0, file.tellg()));
  file.seekg(0);
  const auto cut_short = [&] {
    return failure(path, "is cut short: it ends after " + std::to_string(size) + " bytes");
  };
  std::array<unsigned char, 8> head{};  // the signature, then each chunk's length (big-endian) and type
  const auto read_head = [&] { return bool(file.read(reinterpret_cast<char*>(head.data()), head.size())); };
  constexpr std::array<unsigned char, 8> kSignature{0x89, 'P', 'N', 'G', '\r', '\n', 0x1A, '\n'};
  if (!read_head()) throw cut_short();
  if (head != kSignature) throw failure(path, "is not a PNG file, whatever its name says");
  std::array<unsigned char, 65536> data{};
  for (std::uintmax_t at = 8;;) {
    if (!read_head()) throw cut_short();
    const std::uintmax_t length = big_endian_32(head);
    at += 12 + length;  // length, type, data, checksum
    if (at > size) throw cut_short();
    if (std::equal(head.begin() + 4, head.end(), "IEND")) return;
    if (std::isupper(head[4]) != 0) {
      uLong sum = ::crc32(0, head.data() + 4, 4);
      for (std::uintmax_t left = length; left > 0;) {
        const std::size_t count = std::size_t(std::min<std::uintmax_t>(left, data.size()));
        if (!file.read(reinterpret_cast<char*>(data.data()), std::streamsize(count))) throw cut_short();
        sum = ::crc32(sum, data.data(), uInt(count));
        left -= count;
      }
      std::array<unsigned char, 4> said{};
      if (!file.read(reinterpret_cast<char*>(said.data()), said.size())) throw cut_short();
      if (sum != big_endian_32(said)) {
        throw failure(path,
                      "is damaged: the chunk that ends at byte " + std::to_string(at) + " does not match its checksum");
      }
    }
    file.seekg(static_cast<std::streamoff>(at));
  }
}

OpenImage open_image(const fs::path& path, std::size_t max_values) {
  const image_io::Format& format = image_io::format_of(path);
  std::error_code error;
  const fs::file_status status = fs::status(path, error);
  if (!fs::exists(status)) throw failure(path, "no such file");
  if (!fs::is_regular_file(status)) throw failure(path, "not a regular file");

  if (std::string_view(format.plugin) == "png") check_png_is_whole(path);
  if (std::string_view(format.plugin) == "openexr") {
    image_io::check_exr_header(path, std::min<std::uint64_t>(max_values, most_bytes() / sizeof(float)),
                               kMostCompression);
  }

  // The library's own limits, which it keeps to before it takes memory.
  static const bool limited = OIIO::attribute("limits:channels", 64) && OIIO::attribute("limits:imagesize_MB", 16384);
  static_cast<void>(limited);

  OpenImage open;
  // By the format's name and not by the file's: OpenImageIO gives '?' in names a meaning of its own.
  open.input = OIIO::ImageInput::create(format.plugin);
  if (open.input == nullptr) throw failure(path, "OpenImageIO was built without this format");
  OIIO::ImageSpec wishes;
  wishes.attribute("oiio:UnassociatedAlpha", 1);  // colours as stored, not multiplied by alpha
  if (!open.input->open(path.string(), open.spec, wishes))
    throw failure(path, "cannot be read as an image of this format" + detail(path, *open.input));
  check_spec(path, open.spec, max_values);
  open.size = {open.spec.height, open.spec.width, open.spec.nchannels};
  return open;
}

// Alpha, the second or fourth channel, is linear in every file.
void decode_srgb(Image& image) {
  const int colours = image.channels() <= 2 ? 1 : 3;
  parallel_for(std::size_t(image.height()), 16, [&](std::size_t first, std::size_t last) {
    for (std::size_t y = first; y < last; ++y)
      for (int x = 0; x < image.width(); ++x) {
        float* p = image.pixel(static_cast<int>(y), x);
        for (int c = 0; c < colours; ++c) p[c] = srgb_decode(p[c]);
      }
  });
}

}  // namespace

ImageSize read_image_size(const fs::path& path) {
  return open_image(path, ReadOptions{}.max_values).size;
}

Image read_image(const fs::path& path, const ReadOptions& options) {
  OpenImage open = open_image(path, options.max_values);
  Image image(open.size);
  if (!open.input->read_image(0, 0, 0, open.size.channels, OIIO::TypeDesc::FLOAT, image.values().data()))
    throw failure(path, "is damaged or cut short" + detail(path, *open.input));
  if (open.input->has_error()) throw failure(path, "is damaged" + detail(path, *open.input));
  require_finite(image, path.string());

  const bool srgb =
      options.encoding == Encoding::kAuto ? !open.spec.format.is_floating_point() : options.encoding == Encoding::kSrgb;
  if (srgb) decode_srgb(image);
  return image;
}

void require_finite(ImageView image, const std::string& what) {
  const std::size_t row_length = std::size_t(image.width()) * std::size_t(image.channels());
  const auto finite = [](float v) { return (std::bit_cast<std::uint32_t>(v) & 0x7f800000U) != 0x7f800000U; };
  const auto row_is_finite = [&](int y) {
    const float* row = image.row(y);
    bool all = true;
    for (std::size_t i = 0; i < row_length; ++i) all &= finite(row[i]);  // no early exit, so that it vectorises
    return all;
  };
  for (int y = 0; y < image.height(); ++y) {
    if (row_is_finite(y)) continue;
    for (int x = 0; x < image.width(); ++x)
      for (int c = 0; c < image.channels(); ++c)
        if (const float v = image(y, x, c); !finite(v))
          throw BadInput(what + ": pixel x " + std::to_string(x) + ", y " + std::to_string(y) + ", channel " +
                         std::to_string(c) + " is " + number_text(v) + "; every value must be finite");
  }
}

}  // namespace lightstage::core
