#include "calib/outline/blob.h"

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>

#include "calib/robust/noise.h"
#include "calib/robust/quantile.h"
#include "core/error.h"

namespace lightstage::calib {

namespace {

constexpr const char* kAdvice =
    "; photograph the ball brighter than its surroundings (all lights on, dark background, the whole ball in "
    "view)";

// The median of the responses, so that structure does not matter.
double noise_sigma(core::ImageView v) {
  std::vector<double> responses;
  for (int y = 1; y + 1 < v.height(); ++y) {
    for (int x = 1; x + 1 < v.width(); ++x) responses.push_back(noise_response(v, y, x));
  }
  return robust_sigma(responses);
}

double border_median(core::ImageView v) {
  std::vector<double> values;
  for (int x = 0; x < v.width(); ++x) values.insert(values.end(), {v(0, x), v(v.height() - 1, x)});
  for (int y = 0; y < v.height(); ++y) values.insert(values.end(), {v(y, 0), v(y, v.width() - 1)});
  return quantile(values, 0.5);
}

// 8 bits on a scale that is linear within the noise and logarithmic above it: a ball a thousand times darker
// than the highlights on it still stands well apart from the background.
cv::Mat_<uchar> compressed(core::ImageView v, double background, double unit) {
  cv::Mat_<float> scale(v.height(), v.width());
  for (int y = 0; y < v.height(); ++y) {
    for (int x = 0; x < v.width(); ++x) {
      scale(y, x) = static_cast<float>(std::asinh(std::max(0.0, (v(y, x) - background) / unit)));
    }
  }
  cv::Mat_<uchar> result;
  cv::normalize(scale, result, 0, 255, cv::NORM_MINMAX, CV_8U);
  return result;
}

cv::Mat_<uchar> largest_part(const cv::Mat_<uchar>& mask) {
  cv::Mat labels;
  cv::Mat stats;
  cv::Mat centroids;
  const int count = cv::connectedComponentsWithStats(mask, labels, stats, centroids, 8, CV_32S);
  int largest = 0;
  for (int i = 1; i < count; ++i) {
    if (largest == 0 || stats.at<int>(i, cv::CC_STAT_AREA) > stats.at<int>(largest, cv::CC_STAT_AREA)) largest = i;
  }
  return largest == 0 ? cv::Mat_<uchar>::zeros(mask.size()) : cv::Mat_<uchar>(labels == largest);
}

double median_where(core::ImageView v, const cv::Mat_<uchar>& mask, bool inside) {
  std::vector<double> values;
  for (int y = 0; y < v.height(); ++y) {
    for (int x = 0; x < v.width(); ++x) {
      if ((mask(y, x) != 0) == inside) values.push_back(v(y, x));
    }
  }
  return quantile(values, 0.5);
}

}  // namespace

Blob find_blob(core::ImageView luminance) {
  constexpr double kLeastContrastInSigmas = 6;
  constexpr double kSmallestShareOfPeak = 1e-4;  // unit of the scale where there is no noise
  constexpr double kLargestShareOfPicture = 0.9;
  const float peak = [&] {
    float highest = 0;
    for (int y = 0; y < luminance.height(); ++y) {
      highest = std::max(highest, *std::max_element(luminance.row(y), luminance.row(y) + luminance.width()));
    }
    return highest;
  }();
  Blob blob;
  blob.noise = noise_sigma(luminance);
  const double background = border_median(luminance);
  const double unit = std::max(2 * blob.noise, kSmallestShareOfPeak * (double(peak) - background));
  if (!(unit > 0)) throw core::BadInput(std::string("calibration ball: the picture is uniform") + kAdvice);

  const cv::Mat_<uchar> scale = compressed(luminance, background, unit);
  cv::Mat_<uchar> bright;
  cv::threshold(scale, bright, 0, 255, cv::THRESH_BINARY | cv::THRESH_OTSU);
  const cv::Mat_<uchar> part = largest_part(bright);
  std::vector<std::vector<cv::Point>> contours;
  cv::findContours(part, contours, cv::RETR_EXTERNAL, cv::CHAIN_APPROX_NONE);
  if (contours.empty()) throw core::BadInput(std::string("calibration ball: no bright blob found") + kAdvice);
  cv::Mat_<uchar> filled = cv::Mat_<uchar>::zeros(part.size());
  cv::drawContours(filled, contours, -1, cv::Scalar(255), cv::FILLED);

  blob.level = median_where(luminance, filled, true);
  const double outside = median_where(luminance, filled, false);
  if (cv::countNonZero(filled) > kLargestShareOfPicture * double(filled.total())) {
    throw core::BadInput(std::string("calibration ball: the bright blob fills the picture") + kAdvice);
  }
  if (!(blob.level - outside > std::max(kLeastContrastInSigmas * blob.noise, 0.5 * unit))) {
    throw core::BadInput(std::string("calibration ball: nothing stands out of the noise") + kAdvice);
  }
  for (const cv::Point& p : contours.front()) {
    const bool at_border = p.x < 1 || p.y < 1 || p.x + 1 >= luminance.width() || p.y + 1 >= luminance.height();
    if (!at_border) blob.contour.push_back({double(p.x), double(p.y)});
  }
  return blob;
}

}  // namespace lightstage::calib
