#include "align/tone/tone.h"

#include <algorithm>
#include <cmath>
#include <vector>

#include "core/display.h"

namespace lightstage::align {

double white_level(core::ImageView luminance) {
  std::vector<float> values;
  values.reserve(luminance.size().value_count());
  for (int y = 0; y < luminance.height(); ++y) {
    values.insert(values.end(), luminance.row(y), luminance.row(y) + luminance.width());
  }
  if (values.empty()) return 1;
  const auto rank = static_cast<std::ptrdiff_t>(std::llround(0.99 * double(values.size() - 1)));
  std::nth_element(values.begin(), values.begin() + rank, values.end());
  const double level = values[std::size_t(rank)];
  return level > 0 ? level : 1;
}

core::Image encoded_luminance(core::ImageView luminance, double white) {
  core::Image encoded(luminance);
  for (float& v : encoded.values()) v = core::display_encode(static_cast<float>(double(v) / white));
  return encoded;
}

}  // namespace lightstage::align
