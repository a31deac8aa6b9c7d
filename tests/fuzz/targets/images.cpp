// Pictures in every format that is read, and environment maps.
#include <cmath>

#include "core/image_file.h"
#include "fuzz/target.h"
#include "relight/environment.h"

namespace lightstage::fuzz {

namespace {

constexpr std::size_t kMaxValues = 1 << 20;  // larger ones only take longer

Registration of_format(const std::string& name, const std::string& extension) {
  return Registration({name, [extension](Bytes bytes) {
                         const auto file = write(scratch() / ("picture" + extension), bytes);
                         tolerate([&] { core::read_image_size(file); });
                         const core::Image image = core::read_image(file, {.max_values = kMaxValues});
                         require(image.values().size() <= kMaxValues, "no more values than are allowed");
                         for (const float v : image.values()) require(std::isfinite(v), "values are finite");
                         if (extension == ".hdr" || extension == ".exr") relight::Environment{image};
                       }});
}

const Registration kExr = of_format("image_exr", ".exr");
const Registration kHdr = of_format("image_hdr", ".hdr");
const Registration kJpeg = of_format("image_jpeg", ".jpg");
const Registration kPng = of_format("image_png", ".png");
const Registration kPnm = of_format("image_pnm", ".pgm");
const Registration kTiff = of_format("image_tiff", ".tif");

}  // namespace

}  // namespace lightstage::fuzz
