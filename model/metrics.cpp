#include "model/metrics.h"

#include <opencv2/quality/qualityssim.hpp>

#include "model/flip.h"
#include "model/judging/comparison.h"

namespace lightstage::model {

namespace {

double squared(double v) {
  return v * v;
}

// For values in 0..255 OpenCV's SSIM has its constants, C1 = (0.01 255)^2 and C2 = (0.03 255)^2.
constexpr double kCodeValues = 255;

}  // namespace

double mean_squared_error(core::ImageView a, core::ImageView b, core::ImageView mask) {
  const Comparison pair(a, b, mask);
  return pair.mean([&](int y, int x, int c) { return squared(pair.error(y, x, c)); });
}

double squared_h1(core::ImageView a, core::ImageView b, core::ImageView mask) {
  const Comparison pair(a, b, mask);
  return pair.mean([&](int y, int x, int c) {
    const double here = pair.error(y, x, c);
    double sum = squared(here);
    if (x + 1 < a.width() && pair.inside(y, x + 1)) sum += squared(pair.error(y, x + 1, c) - here);
    if (y + 1 < a.height() && pair.inside(y + 1, x)) sum += squared(pair.error(y + 1, x, c) - here);
    return sum;
  });
}

double dssim(core::ImageView a, core::ImageView b, core::ImageView mask) {
  const Comparison pair(a, b, mask);
  cv::Mat map;
  cv::quality::QualitySSIM::compute(float64_mat(a, kCodeValues), float64_mat(b, kCodeValues), map);
  map.convertTo(map, CV_64F);
  return pair.mean([&](int y, int x, int c) { return (1 - map.ptr<double>(y)[x * a.channels() + c]) / 2; });
}

double flip(core::ImageView a, core::ImageView b, core::ImageView mask) {
  const Comparison pair(a, b, mask);
  const core::Image map = flip_map(a, b);
  return pair.mean([&](int y, int x, int) { return double(map(y, x)); });
}

}  // namespace lightstage::model
