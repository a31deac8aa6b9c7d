#include "calib/spot/brightest_spot.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <opencv2/imgproc.hpp>

namespace lightstage::calib {

namespace {

constexpr double kCircleShare = 0.6;            // of the largest circle in a spot: thinner parts are streaks
constexpr double kLargestShareOfRadius = 0.25;  // of the ball's radius: larger spots are no highlights

// What stands out as a small bright spot: the signal less its morphological opening (over the ball alone, so
// that its bright limb is no spot).
cv::Mat_<float> spots(const BallRegion& region, const cv::Mat_<float>& steady) {
  constexpr float kNowhere = 1e30F;
  const int radius = std::max(2, static_cast<int>(std::ceil(kLargestShareOfRadius * region.radius_px)));
  const cv::Mat brush = cv::getStructuringElement(cv::MORPH_RECT, {2 * radius + 1, 2 * radius + 1});
  cv::Mat inside;  // the rim's own pixels also see what is behind the ball
  cv::erode(region.on_ball, inside, cv::Mat::ones(5, 5, CV_8U));
  cv::Mat_<float> opened = steady.clone();
  opened.setTo(kNowhere, inside == 0);
  cv::erode(opened, opened, brush);
  opened.setTo(-kNowhere, inside == 0);
  cv::dilate(opened, opened, brush);
  cv::Mat_<float> tall = steady - opened;
  tall.setTo(0, opened < -0.5F * kNowhere);
  tall.setTo(0, region.on_ball == 0);
  return tall;
}

}  // namespace

cv::Mat_<float> without_hot_pixels(const cv::Mat_<float>& values) {
  cv::Mat_<float> result(values.size());
  for (int y = 0; y < values.rows; ++y) {
    for (int x = 0; x < values.cols; ++x) {
      float first = std::numeric_limits<float>::lowest();
      float second = first;
      for (int ny = std::max(0, y - 1); ny <= std::min(values.rows - 1, y + 1); ++ny) {
        for (int nx = std::max(0, x - 1); nx <= std::min(values.cols - 1, x + 1); ++nx) {
          second = std::max(second, std::min(first, values(ny, nx)));
          first = std::max(first, values(ny, nx));
        }
      }
      result(y, x) = second;
    }
  }
  return result;
}

std::optional<Spot> brightest_spot(const BallRegion& region, const cv::Mat_<float>& steady) {
  const cv::Mat_<float> tall = spots(region, steady);
  double peak = 0;
  cv::Point at;
  cv::minMaxLoc(tall, nullptr, &peak, nullptr, &at);
  if (!(peak > 0)) return std::nullopt;
  // A clipped spot near the rim reaches beyond the ball: cut at the rim, its middle would seem to lie too far inside.
  const double half_height = double(steady(at)) - 0.5 * peak;
  const cv::Mat above = (tall > 0.5 * peak) | ((region.on_ball == 0) & (steady > half_height));
  cv::Mat labels_any;
  const int count = cv::connectedComponents(above, labels_any, 8, CV_32S);
  const cv::Mat_<int> labels = labels_any;
  std::vector<double> flux(std::size_t(count), 0.0);
  for (int y = 0; y < tall.rows; ++y) {
    for (int x = 0; x < tall.cols; ++x) {
      if (labels(y, x) > 0) flux[std::size_t(labels(y, x))] += tall(y, x);
    }
  }
  const auto best = static_cast<int>(std::max_element(flux.begin(), flux.end()) - flux.begin());
  const double light = flux[std::size_t(best)];
  // The body: all circles in those pixels that are nearly as large as the largest. Glare draws streaks, which
  // are thinner.
  cv::Mat_<float> depth;
  cv::distanceTransform(labels == best, depth, cv::DIST_L2, cv::DIST_MASK_PRECISE);
  double radius = 0;
  cv::minMaxLoc(depth, nullptr, &radius);
  if (radius > kLargestShareOfRadius * region.radius_px) return std::nullopt;
  const double share = kCircleShare * radius;
  cv::Mat_<float> from_centres;
  cv::distanceTransform(depth < share, from_centres, cv::DIST_L2, cv::DIST_MASK_PRECISE);
  Spot spot;
  spot.radius_px = radius;
  spot.light = light;
  cv::distanceTransform((labels != best) | (from_centres >= share), spot.distance, cv::DIST_L2, cv::DIST_MASK_PRECISE);
  return spot;
}

double rival_share(const BallRegion& region, const cv::Mat_<float>& steady, const Spot& spot, double reach_px) {
  const cv::Mat_<float> tall = spots(region, steady);
  const cv::Mat_<uchar> own = spot.distance <= reach_px;
  double peak = 0;
  cv::minMaxLoc(tall, nullptr, &peak, nullptr, nullptr, own);
  double second = 0;
  cv::minMaxLoc(tall, nullptr, &second, nullptr, nullptr, own == 0);
  // Half its own height, as for the strongest spot; what is much dimmer than that one is no rival but glare.
  constexpr double kLeastShare = 0.25;
  const cv::Mat above = (tall > std::max(kLeastShare * peak, 0.5 * second)) & (own == 0);
  cv::Mat labels_any;
  const int count = cv::connectedComponents(above, labels_any, 8, CV_32S);
  const cv::Mat_<int> labels = labels_any;
  std::vector<double> light(std::size_t(count), 0.0);
  for (int y = 0; y < tall.rows; ++y) {
    for (int x = 0; x < tall.cols; ++x) {
      if (labels(y, x) > 0) light[std::size_t(labels(y, x))] += tall(y, x);
    }
  }
  return spot.light > 0 ? *std::max_element(light.begin(), light.end()) / spot.light : 0;
}

namespace {

// Whether, at some level from `lowest` up, `height` within `inside` falls apart into two parts that each reach `summit(level)`.
template <class Summit>
bool falls_apart(const cv::Mat_<float>& height, const cv::Mat_<uchar>& inside, double lowest, double highest,
                 Summit summit) {
  constexpr int kLevels = 24;
  for (int k = 0; k < kLevels; ++k) {
    const double level = lowest + (highest - lowest) * k / kLevels;
    const cv::Mat above = (height > level) & inside;
    cv::Mat labels_any;
    const int count = cv::connectedComponents(above, labels_any, 8, CV_32S);
    if (count < 3) continue;
    const cv::Mat_<int> labels = labels_any;
    // The second highest pixel, so that a single hot one is nothing.
    std::vector<float> first(std::size_t(count), 0.0F), top = first;
    for (int y = 0; y < height.rows; ++y) {
      for (int x = 0; x < height.cols; ++x) {
        const auto label = std::size_t(labels(y, x));
        if (label == 0) continue;
        top[label] = std::max(top[label], std::min(first[label], height(y, x)));
        first[label] = std::max(first[label], height(y, x));
      }
    }
    if (std::count_if(top.begin() + 1, top.end(), [&](float t) { return t >= summit(level); }) > 1) return true;
  }
  return false;
}

}  // namespace

bool has_two_parts(const BallRegion& region, const Spot& spot, bool clipped) {
  // What is around the body by its own width holds a part that the body, the largest circles in the spot, leaves out.
  const cv::Mat_<uchar> near = spot.distance <= std::max(2.0, 2.5 * spot.radius_px);
  if (!clipped) {
    constexpr double kValley = 1.0 / 7, kNoises = 6;
    double peak = 0;
    cv::minMaxLoc(region.signal, nullptr, &peak, nullptr, nullptr, near);
    const double least = std::max(kValley * peak, kNoises * region.noise);
    return falls_apart(region.signal, near, 0.4 * peak, peak, [&](double level) { return level + least; });
  }
  constexpr double kWaist = 0.8, kLeastShare = 0.5, kLeastRadiusPx = 1.4;
  double peak = 0;
  cv::minMaxLoc(region.signal, nullptr, &peak, nullptr, nullptr, near);
  const cv::Mat full = (region.signal >= kClippedShare * peak) & near;
  cv::Mat_<float> depth;
  cv::distanceTransform(full, depth, cv::DIST_L2, cv::DIST_MASK_PRECISE);
  double radius = 0;
  cv::minMaxLoc(depth, nullptr, &radius);
  if (radius < kLeastRadiusPx) return false;
  return falls_apart(depth, near, 0, radius, [&](double level) {
    return std::max({kLeastRadiusPx, kLeastShare * radius, level / kWaist});
  });
}

}  // namespace lightstage::calib
