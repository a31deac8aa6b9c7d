#include "relight/picture.h"

#include <algorithm>
#include <cmath>
#include <vector>

#include "core/display.h"
#include "core/error.h"
#include "core/file.h"
#include "core/image_file.h"

namespace lightstage::relight {

WrittenPicture picture_files(const std::filesystem::path& exr) {
  return {exr, std::filesystem::path(exr).replace_extension(".png")};
}

WrittenPicture write_picture(const std::filesystem::path& path, core::ImageView linear, double stops,
                             const std::function<void(const std::filesystem::path& exr)>& finished) {
  if (path.extension() != ".exr")
    throw core::UsageError("'" + path.string() +
                           "': pictures are written as .exr (with a .png beside it); end the name in .exr");
  if (!std::isfinite(stops)) throw core::UsageError("an exposure must be a finite number of stops");
  WrittenPicture written = picture_files(path);
  const core::Image shown = core::expose(linear, stops);
  core::replace_file_atomically(written.exr, [&](const std::filesystem::path& temporary) {
    core::write_image(temporary, linear);
    if (finished) finished(temporary);
    core::write_image(written.png, shown);
  });
  return written;
}

double auto_exposure_stops(core::ImageView linear, core::ImageView mask) {
  if (!mask.empty() && mask.size() != core::ImageSize{linear.height(), linear.width(), 1})
    throw core::BadInput("the mask for an exposure is not of the picture's size");
  core::require_finite(linear, "a picture to be exposed");
  std::vector<float> values;
  for (int y = 0; y < linear.height(); ++y)
    for (int x = 0; x < linear.width(); ++x)
      if (mask.empty() || mask(y, x) > 0.5f)
        values.insert(values.end(), linear.pixel(y, x), linear.pixel(y, x) + linear.channels());
  if (values.empty()) throw core::BadInput("nothing to expose for: no pixel is inside the mask");
  const double bright = core::quantile(values, 0.995);
  if (!(bright > 0)) return 0;
  return std::clamp(-std::log2(bright), -100.0, 100.0);
}

}  // namespace lightstage::relight
