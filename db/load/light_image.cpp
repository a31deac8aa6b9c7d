#include "db/load/light_image.h"

#include "core/error.h"

namespace lightstage::db {

void subtract_dark(core::Image& image, core::ImageView dark) {
  if (dark.empty()) return;
  if (dark.size() != image.size()) throw core::StoreError("a dark frame is not of the size of the frames it is for");
  for (int y = 0; y < image.height(); ++y) {
    float* row = image.pixel(y, 0);
    for (int i = 0; i < image.width() * image.channels(); ++i) row[i] -= dark.row(y)[i];
  }
}

void divide_by_gain(core::Image& image, const std::array<double, 3>& gain) {
  const bool colour = image.channels() >= 3;
  const double grey = (gain[0] + gain[1] + gain[2]) / 3;
  const std::size_t channels = std::size_t(image.channels());
  const auto values = image.values();
  for (std::size_t i = 0; i < values.size(); ++i) {
    const std::size_t channel = i % channels;
    if (channel < 3) values[i] = float(double(values[i]) / (colour ? gain[channel] : grey));
  }
}

void divide_by_flat(core::Image& image, core::ImageView flat) {
  if (flat.empty()) return;
  const bool same_channels = flat.channels() == image.channels();
  if (flat.height() != image.height() || flat.width() != image.width() || (!same_channels && flat.channels() != 1)) {
    throw core::StoreError("a flat field is not of the size of the frames it is for");
  }
  const int repeats = same_channels ? 1 : image.channels();
  for (int y = 0; y < image.height(); ++y) {
    float* row = image.pixel(y, 0);
    for (int i = 0; i < image.width() * image.channels(); ++i) row[i] /= flat.row(y)[i / repeats];
  }
}

void apply_colour(core::Image& image, const ColourMatrix& matrix) {
  if (image.channels() != 3) return;
  const auto values = image.values();
  for (std::size_t i = 0; i < values.size(); i += 3) {
    const std::array<double, 3> in{double(values[i]), double(values[i + 1]), double(values[i + 2])};
    for (std::size_t c = 0; c < 3; ++c) {
      values[i + c] = float(matrix[c][0] * in[0] + matrix[c][1] * in[1] + matrix[c][2] * in[2]);
    }
  }
}

}  // namespace lightstage::db
