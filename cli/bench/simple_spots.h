// Plain ways of finding a highlight, for comparison with calib/mirror_ball.h.
#pragma once

#include <optional>
#include <string_view>

#include "calib/mirror_ball.h"

namespace lightstage::cli {

enum class SpotMethod {
  kFit,  // calib::find_highlight
  kCentroid,  // the mean place of the largest connected patch of pixels of more than half the ball's largest value, each counting 1
  kBrightest  // the ball's pixel with the largest value; of several equal ones their middle
};
inline constexpr SpotMethod kSpotMethods[] = {SpotMethod::kFit, SpotMethod::kCentroid, SpotMethod::kBrightest};
std::string_view name_of(SpotMethod method);

// The highlight by that method; the plain ones claim a standard error of a third of a pixel, and find one on every ball that is not black.
std::optional<calib::Highlight> find_spot(SpotMethod method, core::ImageView picture, const core::CameraModel& camera,
                                          const calib::Sphere& ball, double saturation);

}  // namespace lightstage::cli
