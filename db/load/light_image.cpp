#include "db/load/light_image.h"

#include <algorithm>

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

core::Image merge_exposures(std::span<const Exposure> exposures) {
  // Sensors leave linearity a little before they clip.
  constexpr double kReliable = 0.95;
  core::Image merged(exposures.front().image.size());
  for (const Exposure& e : exposures) {
    if (e.image.size() != merged.size()) throw core::StoreError("exposures of one light differ in size");
  }
  const auto limit = [](const Exposure& e) { return e.saturation > 0 ? e.saturation : HUGE_VAL; };
  const auto last = std::max_element(exposures.begin(), exposures.end(),
                                     [&](const auto& a, const auto& b) { return limit(a) < limit(b); });
  for (std::size_t i = 0; i < merged.values().size(); ++i) {
    double sum = 0, seconds = 0;
    for (const Exposure& e : exposures) {
      const double value = double(e.image.values()[i]);
      if (value >= kReliable * limit(e)) continue;
      sum += e.seconds * value;
      seconds += e.seconds;
    }
    merged.values()[i] = seconds > 0 ? float(sum / seconds) : last->image.values()[i];
  }
  return merged;
}

}  // namespace lightstage::db
