#include <OpenImageIO/filesystem.h>
#include <OpenImageIO/imageio.h>

#include <algorithm>
#include <limits>
#include <mutex>

#include "core/display.h"
#include "core/error.h"
#include "core/file.h"
#include "core/image_file.h"
#include "core/image_io/format.h"
#include "core/image_io/plain_exr.h"
#include "core/text.h"

namespace lightstage::core {

namespace fs = std::filesystem;

namespace {

constexpr float kLargestHalf = 65504.0f;

OIIO::TypeDesc oiio_type(PixelType type) {
  switch (type) {
    case PixelType::kUint8:
      return OIIO::TypeDesc::UINT8;
    case PixelType::kUint16:
      return OIIO::TypeDesc::UINT16;
    case PixelType::kHalf:
      return OIIO::TypeDesc::HALF;
    case PixelType::kFloat:
      return OIIO::TypeDesc::FLOAT;
  }
  throw Error(ErrorKind::kInternal, "unknown pixel type");
}

bool is_integer(PixelType type) {
  return type == PixelType::kUint8 || type == PixelType::kUint16;
}

// The values as the file holds them, clamped to what it can hold.
Image encoded(ImageView image, PixelType type, bool srgb, float lowest, float highest) {
  Image result(image);
  const int colours = image.channels() <= 2 ? 1 : 3;  // alpha is linear in every file
  const std::size_t channels = std::size_t(image.channels());
  const std::span<float> values = result.values();
  for (std::size_t i = 0; i < values.size(); ++i) {
    float v = values[i];
    if (is_integer(type)) v = std::clamp(v, 0.0f, 1.0f);
    if (srgb && int(i % channels) < colours) v = srgb_encode(v);
    values[i] = std::clamp(v, lowest, highest);
  }
  return result;
}

OIIO::ImageSpec fresh_spec(ImageSize size, PixelType type, const image_io::Format& format, bool srgb, bool compressed) {
  OIIO::ImageSpec spec(size.width, size.height, size.channels, oiio_type(type));
  if (size.channels <= 2)
    spec.channelnames = size.channels == 1 ? std::vector<std::string>{"Y"} : std::vector<std::string>{"Y", "A"};
  spec.alpha_channel = size.channels % 2 == 0 ? size.channels - 1 : -1;
  spec.attribute("oiio:UnassociatedAlpha", 1);  // colours go into the file as they are
  // OpenImageIO puts the time of writing into TIFF and EXR when no date is given; blanks are the date
  // "unknown" of the Exif standard (CIPA DC-008, tag DateTime).
  spec.attribute("DateTime", "    :  :     :  :  ");
  const std::string_view plugin = format.plugin;
  if (plugin == "jpeg") spec.attribute("Compression", "jpeg:95");
  if (plugin == "tiff") {
    spec.attribute("Compression", "zip");
    spec.attribute("tiff:write_exif", 0);  // which fails in memory, and there is nothing to put in
  }
  if (plugin == "openexr") {
    spec.attribute("Compression", compressed ? "zip" : "none");
    if (!srgb && size.channels >= 3) {
      // Rec. 709 primaries and D65 white, in the two ways that readers of EXR look for.
      constexpr float kChromaticities[8] = {0.64f, 0.33f, 0.30f, 0.60f, 0.15f, 0.06f, 0.3127f, 0.3290f};
      spec.attribute("chromaticities", OIIO::TypeDesc(OIIO::TypeDesc::FLOAT, 8), kChromaticities);
      spec.attribute("colorInteropID", "lin_rec709_scene");
    }
  }
  return spec;
}

// By the library, in memory first: several of the libraries below do not report a full disk.
std::vector<unsigned char> encode(const image_io::Format& format, const fs::path& path, const OIIO::ImageSpec& spec,
                                  const Image& values) {
  std::vector<unsigned char> bytes;
  OIIO::Filesystem::IOVecOutput sink(bytes);
  const std::unique_ptr<OIIO::ImageOutput> output = OIIO::ImageOutput::create(format.plugin);
  const auto fail = [&](const std::string& problem) {
    return BadInput("cannot write " + path.string() + ": " + problem);
  };
  if (output == nullptr || !output->set_ioproxy(&sink)) throw fail("OpenImageIO cannot write this format");
  const bool written = output->open(path.string(), spec) &&
                       output->write_image(OIIO::TypeDesc::FLOAT, values.values().data()) && output->close();
  if (!written) throw fail(output->geterror());
  return bytes;
}

// What stands before the pixels of uncompressed EXRs, as the library writes it. Cameras take many pictures of one size, so the last one's is kept.
std::vector<unsigned char> plain_header(const image_io::Format& format, ImageSize size) {
  static std::mutex mutex;
  static ImageSize last;
  static std::vector<unsigned char> header;
  const std::lock_guard lock(mutex);
  if (!(last == size)) {
    std::vector<unsigned char> file =
        encode(format, "black.exr", fresh_spec(size, PixelType::kHalf, format, false, false), Image(size));
    file.resize(image_io::pixels_begin(file, size));
    header = std::move(file);
    last = size;
  }
  return header;
}

}  // namespace

std::vector<unsigned char> encode_image(const fs::path& path, ImageView image, const WriteOptions& options) {
  const image_io::Format& format = image_io::format_of(path);
  const auto fail = [&](const std::string& problem) {
    return BadInput("cannot write " + path.string() + ": " + problem);
  };
  if (image.empty()) throw fail("the image has no pixels");
  const auto holds = [](const auto& list, const auto& item) {
    return std::find(list.begin(), list.end(), item) != list.end();
  };
  if (!holds(format.channel_counts, image.channels()))
    throw fail("this format cannot hold " + std::to_string(image.channels()) + " channels");
  const PixelType type = options.pixel_type.value_or(format.pixel_types.front());
  if (!holds(format.pixel_types, type)) throw fail("this format cannot hold that type of pixel");
  const bool srgb = options.encoding == Encoding::kAuto ? is_integer(type) : options.encoding == Encoding::kSrgb;
  if (!options.compressed && std::string_view(format.plugin) == "openexr" && type == PixelType::kHalf && !srgb) {
    std::vector<unsigned char> bytes = image_io::plain_exr(plain_header(format, image.size()), image);
    if (!bytes.empty()) return bytes;
  }
  require_finite(image, "cannot write " + path.string());
  float highest = std::numeric_limits<float>::max(), lowest = -highest;
  if (is_integer(type)) lowest = 0, highest = 1;
  if (type == PixelType::kHalf) lowest = -kLargestHalf, highest = kLargestHalf;
  if (std::string_view(format.plugin) == "hdr") lowest = 0;  // RGBE has no sign
  const Image values = encoded(image, type, srgb, lowest, highest);
  return encode(format, path, fresh_spec(image.size(), type, format, srgb, options.compressed), values);
}

void write_image(const fs::path& path, ImageView image, const WriteOptions& options) {
  const std::vector<unsigned char> bytes = encode_image(path, image, options);
  write_file_atomically(path, {reinterpret_cast<const char*>(bytes.data()), bytes.size()});
}

}  // namespace lightstage::core
