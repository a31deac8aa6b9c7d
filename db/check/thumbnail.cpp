#include "db/check/thumbnail.h"

#include <algorithm>
#include <cmath>

#include "core/display.h"

namespace lightstage::db {

core::Image shrink(core::ImageView linear, int longest_side) {
  const int longest = std::max(linear.height(), linear.width());
  const int factor = std::max(1, (longest + longest_side - 1) / longest_side);
  return core::shrink_by_box(linear, factor);
}

core::Image thumbnail(core::ImageView linear, int longest_side) {
  return core::to_luminance(shrink(linear, longest_side));
}

core::Image row_detail(core::ImageView linear, int longest_side) {
  const core::Image shown = core::display_encode(core::to_luminance(linear));
  core::Image squares(shown.height(), shown.width(), 1);
  for (int y = 1; y + 1 < shown.height(); ++y) {
    for (int x = 0; x < shown.width(); ++x) {
      const float difference = shown(y, x) - 0.5F * (shown(y - 1, x) + shown(y + 1, x));
      squares(y, x) = difference * difference;
    }
  }
  core::Image detail = thumbnail(squares, longest_side);
  for (float& value : detail.values()) value = std::sqrt(value);
  return detail;
}

}  // namespace lightstage::db
