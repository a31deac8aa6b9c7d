#include "model/classical/highlight_motion.h"

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>
#include <opencv2/video/tracking.hpp>
#include <vector>

#include "core/display.h"

namespace lightstage::model {

namespace {

constexpr int kSmallestSide = 16;

// Encoded brightness on a scale of 0 to 255, smoothed so that small highlights have slopes to follow.
cv::Mat_<float> prepared(core::ImageView picture, double white) {
  cv::Mat_<float> result(picture.height(), picture.width());
  for (int y = 0; y < result.rows; ++y) {
    for (int x = 0; x < result.cols; ++x) {
      double sum = 0;
      for (int c = 0; c < picture.channels(); ++c) sum += double(picture(y, x, c));
      const double share = std::clamp(sum / picture.channels() / white, 0.0, 1.0);
      result(y, x) = 255 * core::display_encode(float(share));
    }
  }
  cv::GaussianBlur(result, result, {}, 1.0, 1.0, cv::BORDER_REPLICATE);
  return result;
}

// How much of the difference of the pictures the flow explains, in [0, 1], about every pixel.
cv::Mat_<float> share_explained(const cv::Mat_<float>& from, const cv::Mat_<float>& to,
                                const cv::Mat_<cv::Vec2f>& flow) {
  cv::Mat_<cv::Vec2f> places(flow.size());
  for (int y = 0; y < flow.rows; ++y)
    for (int x = 0; x < flow.cols; ++x) places(y, x) = cv::Vec2f(float(x), float(y)) + flow(y, x);
  cv::Mat_<float> brought;
  cv::remap(to, brought, places, cv::noArray(), cv::INTER_LINEAR, cv::BORDER_REPLICATE);
  cv::Mat_<float> before = cv::abs(from - to), after = cv::abs(from - brought);
  constexpr double kSigma = 2;
  cv::GaussianBlur(before, before, {}, kSigma, kSigma, cv::BORDER_REPLICATE);
  cv::GaussianBlur(after, after, {}, kSigma, kSigma, cv::BORDER_REPLICATE);
  cv::Mat_<float> share(flow.size());
  // All of it counts where a third of the difference is left, none where two thirds are, or it is about as small as noise, codes of 255.
  constexpr float kNoise = 4;
  for (int y = 0; y < flow.rows; ++y)
    for (int x = 0; x < flow.cols; ++x)
      share(y, x) = std::clamp((2 * before(y, x) - 3 * after(y, x)) / (before(y, x) + kNoise), 0.0F, 1.0F);
  return share;
}

}  // namespace

core::Image highlight_flow(core::ImageView from, core::ImageView to, double white) {
  core::Image result(from.height(), from.width(), 2);
  if (std::min(from.height(), from.width()) < kSmallestSide) return result;
  const cv::Mat_<float> a = prepared(from, white), b = prepared(to, white);
  cv::Mat_<uchar> a8, b8;
  a.convertTo(a8, CV_8U);
  b.convertTo(b8, CV_8U);
  const cv::Ptr<cv::DISOpticalFlow> dis = cv::DISOpticalFlow::create();
  // OpenCV reads beyond its buffers when the finest scale is coarser than the coarsest one it chooses.
  dis->setFinestScale(std::max(from.height(), from.width()) < 4 * kSmallestSide ? 0 : 1);
  dis->setPatchStride(4);
  dis->setGradientDescentIterations(25);
  dis->setVariationalRefinementIterations(5);
  cv::Mat_<cv::Vec2f> flow;
  dis->calc(a8, b8, flow);
  const cv::Mat_<float> share = share_explained(a, b, flow);
  for (int y = 0; y < flow.rows; ++y) {
    for (int x = 0; x < flow.cols; ++x) {
      result(y, x, 0) = share(y, x) * flow(y, x)[0];
      result(y, x, 1) = share(y, x) * flow(y, x)[1];
    }
  }
  return result;
}

core::Image moved(core::ImageView picture, core::ImageView displacement) {
  const int height = picture.height(), width = picture.width(), channels = picture.channels();
  core::Image result(picture.size());
  std::vector<double> sums(result.values().size()), cover(std::size_t(height) * std::size_t(width));
  const auto put = [&](int y, int x, double share, const float* values) {
    if (share == 0 || y < 0 || x < 0 || y >= height || x >= width) return;
    const std::size_t pixel = std::size_t(y) * std::size_t(width) + std::size_t(x);
    cover[pixel] += share;
    for (int c = 0; c < channels; ++c)
      sums[pixel * std::size_t(channels) + std::size_t(c)] += share * double(values[c]);
  };
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      const double to_x = x + std::clamp(double(displacement(y, x, 0)), -1e6, 1e6);
      const double to_y = y + std::clamp(double(displacement(y, x, 1)), -1e6, 1e6);
      const double left = std::floor(to_x), top = std::floor(to_y), fx = to_x - left, fy = to_y - top;
      const float* values = picture.pixel(y, x);
      put(int(top), int(left), (1 - fy) * (1 - fx), values);
      put(int(top), int(left) + 1, (1 - fy) * fx, values);
      put(int(top) + 1, int(left), fy * (1 - fx), values);
      put(int(top) + 1, int(left) + 1, fy * fx, values);
    }
  }
  // Below half of a pixel the place has been left rather than thinly covered.
  constexpr double kThin = 0.5;
  for (std::size_t pixel = 0; pixel < cover.size(); ++pixel) {
    const double divisor = std::max(cover[pixel], kThin);
    for (std::size_t v = pixel * std::size_t(channels); v < (pixel + 1) * std::size_t(channels); ++v)
      result.values()[v] = float(sums[v] / divisor);
  }
  return result;
}

}  // namespace lightstage::model
