#include <OpenImageIO/imageio.h>

#include <bit>
#include <cmath>
#include <system_error>

#include "core/display.h"
#include "core/error.h"
#include "core/image_file.h"
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

BadInput failure(const fs::path& path, const std::string& problem) {
  return BadInput(path.string() + ": " + problem);
}

// One line, without the newlines that libraries put into their messages.
std::string one_line(std::string text) {
  for (char& c : text)
    if (c == '\n' || c == '\r') c = ' ';
  return std::string(trim(text));
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
  const std::uint64_t values =
      std::uint64_t(spec.width) * std::uint64_t(spec.height) * std::uint64_t(spec.nchannels);
  const std::string claim = "its header claims " + std::to_string(spec.width) + "x" +
                            std::to_string(spec.height) + "x" + std::to_string(spec.nchannels) + " values";
  if (values > max_values)
    throw failure(path, claim + ", more than the " + std::to_string(max_values) + " allowed");
  std::error_code error;
  const std::uintmax_t bytes = fs::file_size(path, error);
  if (!error && values > kAlwaysAllowedValues && values / kMostCompression > bytes)
    throw failure(path, claim + ", which a file of " + std::to_string(bytes) + " bytes cannot hold");
}

OpenImage open_image(const fs::path& path, std::size_t max_values) {
  const image_io::Format& format = image_io::format_of(path);
  std::error_code error;
  const fs::file_status status = fs::status(path, error);
  if (!fs::exists(status)) throw failure(path, "no such file");
  if (!fs::is_regular_file(status)) throw failure(path, "not a regular file");

  OpenImage open;
  // By the format's name and not by the file's: OpenImageIO gives '?' in names a meaning of its own.
  open.input = OIIO::ImageInput::create(format.plugin);
  if (open.input == nullptr)
    throw failure(path, "OpenImageIO cannot read this format: " + one_line(OIIO::geterror()));
  OIIO::ImageSpec wishes;
  wishes.attribute("oiio:UnassociatedAlpha", 1);  // colours as stored, not multiplied by alpha
  if (!open.input->open(path.string(), open.spec, wishes))
    throw failure(path, "cannot be read as an image: " + one_line(open.input->geterror()));
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
    throw failure(path, "is damaged or cut short: " + one_line(open.input->geterror()));
  if (open.input->has_error()) throw failure(path, "is damaged: " + one_line(open.input->geterror()));
  require_finite(image, path.string());

  const bool srgb = options.encoding == Encoding::kAuto ? !open.spec.format.is_floating_point()
                                                        : options.encoding == Encoding::kSrgb;
  if (srgb) decode_srgb(image);
  return image;
}

void require_finite(ImageView image, const std::string& what) {
  const std::size_t row_length = std::size_t(image.width()) * std::size_t(image.channels());
  const auto finite = [](float v) { return (std::bit_cast<std::uint32_t>(v) & 0x7f800000U) != 0x7f800000U; };
  const auto row_is_finite = [&](int y) {
    const float* row = image.row(y);
    bool all = true;
    for (std::size_t i = 0; i < row_length; ++i)
      all &= finite(row[i]);  // no early exit, so that it vectorises
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
