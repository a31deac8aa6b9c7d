// The brightest compact spot on a ball, to the pixel.
#pragma once

#include <opencv2/core.hpp>
#include <optional>

#include "calib/spot/ball_region.h"

namespace lightstage::calib {

struct Spot {
  cv::Mat_<float> distance;  // of each pixel from the spot's body; 0 in it
  double radius_px = 0;      // of the largest circle in the body
  double light = 0;          // sum over its pixels of the height above what is around it
};

// Of each pixel and its neighbours the second brightest: one hot pixel is nothing.
cv::Mat_<float> without_hot_pixels(const cv::Mat_<float>& values);

// Of what is small and bright, the connected pixels at half the greatest height that hold the most light. `steady` is the region's signal
// without hot pixels. Nothing when nothing stands out or it is larger than a quarter of the ball's radius.
std::optional<Spot> brightest_spot(const BallRegion& region, const cv::Mat_<float>& steady);
// The light in the next strongest spot, beyond `reach_px` of `spot`'s body, over that in `spot`; 0 when there is none.
double rival_share(const BallRegion& region, const cv::Mat_<float>& steady, const Spot& spot, double reach_px);

// Whether the spot is two that touch: a valley of a seventh of its height between two summits, each well above the noise; of a clipped spot, a
// waist of less than four fifths of the lesser part's width between two round parts, one at least half as wide as the other.
bool has_two_parts(const BallRegion& region, const Spot& spot, bool clipped);

}  // namespace lightstage::calib
