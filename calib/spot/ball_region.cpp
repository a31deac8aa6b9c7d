#include "calib/spot/ball_region.h"

#include <cmath>
#include <numbers>
#include <opencv2/imgproc.hpp>

#include "calib/ball/cone.h"
#include "calib/robust/noise.h"
#include "calib/robust/quantile.h"

namespace lightstage::calib {

namespace {

// The 90th percentile of the responses instead of their median, since coarse quantisation makes most of a dark picture's 0.
double noise_on_ball(const BallRegion& region) {
  const core::ImageView signal(region.signal.ptr<float>(), {region.signal.rows, region.signal.cols, 1},
                               region.signal.step1());
  std::vector<double> magnitudes;
  for (int y = 1; y + 1 < signal.height(); ++y) {
    for (int x = 1; x + 1 < signal.width(); ++x) {
      if (region.on_ball(y, x) != 0) magnitudes.push_back(std::abs(noise_response(signal, y, x)));
    }
  }
  return quantile(magnitudes, 0.9) / 1.645;  // the normal distribution's 90th percentile of magnitudes
}

}  // namespace

std::optional<BallRegion> cut_out_ball(core::ImageView picture, const core::CameraModel& camera, const Sphere& ball,
                                       double saturation) {
  constexpr int kSides = 256;
  constexpr int kFractionBits = 4;
  constexpr double kMarginInRadii = 0.25;
  const Cone cone = cone_around(camera, ball);
  BallRegion region;
  region.radius_px = outline_radius_px(camera, cone);
  const double pixel_angle = cone.half_angle / region.radius_px;
  std::vector<cv::Point> outline;
  std::vector<cv::Point2f> corners;
  for (int i = 0; i < kSides; ++i) {
    const auto p = pixel_on_cone(camera, cone, 2 * std::numbers::pi * i / kSides, cone.half_angle + pixel_angle);
    if (!p) return std::nullopt;
    outline.emplace_back(cvRound(p->x * (1 << kFractionBits)), cvRound(p->y * (1 << kFractionBits)));
    corners.emplace_back(float(p->x), float(p->y));
  }
  // A clipped highlight near the rim reaches beyond the ball.
  const int margin = static_cast<int>(std::ceil(kMarginInRadii * region.radius_px));
  const cv::Rect ball_box = cv::boundingRect(corners);
  region.box =
      cv::Rect(ball_box.x - margin, ball_box.y - margin, ball_box.width + 2 * margin, ball_box.height + 2 * margin) &
      cv::Rect(0, 0, picture.width(), picture.height());
  if (region.box.width < 3 || region.box.height < 3) return std::nullopt;
  cv::Mat_<uchar> whole = cv::Mat_<uchar>::zeros(picture.height(), picture.width());
  cv::fillConvexPoly(whole, outline, cv::Scalar(255), cv::LINE_8, kFractionBits);
  region.on_ball = whole(region.box).clone();

  region.signal.create(region.box.size());
  region.clipped = cv::Mat_<uchar>::zeros(region.box.size());
  const float limit = static_cast<float>(kClippedShare * saturation);
  for (int y = 0; y < region.box.height; ++y) {
    for (int x = 0; x < region.box.width; ++x) {
      const float* pixel = picture.pixel(region.box.y + y, region.box.x + x);
      float sum = 0;
      for (int c = 0; c < picture.channels(); ++c) {
        if (saturation > 0 && pixel[c] >= limit) region.clipped(y, x) = 255;
        sum += pixel[c];
      }
      region.signal(y, x) = sum / static_cast<float>(picture.channels());
    }
  }
  region.noise = noise_on_ball(region);
  return region;
}

}  // namespace lightstage::calib
