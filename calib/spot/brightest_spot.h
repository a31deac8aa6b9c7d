// The brightest compact spot on a ball, to the pixel.
#pragma once

#include <opencv2/core.hpp>
#include <optional>

#include "calib/spot/ball_region.h"

namespace lightstage::calib {

struct Spot {
  cv::Mat_<float> distance;  // of each pixel from the spot's body; 0 in it
  double radius_px = 0;      // of the largest circle in the body
};

// Of each pixel and its neighbours the second brightest: one hot pixel is nothing.
cv::Mat_<float> without_hot_pixels(const cv::Mat_<float>& values);

// Of what is small and bright, the connected pixels at half the greatest height that hold the most light. `steady` is the region's signal
// without hot pixels. Nothing when nothing stands out or it is larger than a quarter of the ball's radius.
std::optional<Spot> brightest_spot(const BallRegion& region, const cv::Mat_<float>& steady);

}  // namespace lightstage::calib
