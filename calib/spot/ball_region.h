// The part of a picture that shows a ball.
#pragma once

#include <opencv2/core.hpp>
#include <optional>

#include "calib/sphere_fit.h"
#include "core/camera_model.h"
#include "core/image.h"

namespace lightstage::calib {

constexpr double kClippedShare = 0.97;  // of the saturation: noise and a subtracted dark frame lower it a little

struct BallRegion {
  cv::Rect box;             // in the picture; around the ball, a quarter of its radius more on every side
  cv::Mat_<float> signal;   // mean over the channels
  cv::Mat_<uchar> on_ball;  // the ball and one pixel all round
  cv::Mat_<uchar> clipped;  // in any channel
  double radius_px = 0;     // of the ball
  double noise = 0;         // standard deviation of the signal's noise on the ball
};

// Nothing when no part of the ball is in the picture. `saturation` 0: not known, nothing counts as clipped.
std::optional<BallRegion> cut_out_ball(core::ImageView picture, const core::CameraModel& camera, const Sphere& ball,
                                       double saturation);

}  // namespace lightstage::calib
