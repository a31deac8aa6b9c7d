// Xue, Zhang, Mou and Bovik 2014, "Gradient magnitude similarity deviation: a highly efficient perceptual image quality index".
#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>

#include "model/judging/comparison.h"
#include "model/metrics.h"

namespace lightstage::model {

namespace {

constexpr double kC = 170.0 / (255 * 255);  // section III-A, for values in [0, 1]

// The length of the Prewitt gradient of the luma, of which pairs of pixels were averaged.
cv::Mat gradient_magnitude(core::ImageView picture) {
  const cv::Mat luma = halved(float64_mat(core::to_luminance(picture)));
  const std::vector<double> difference{1, 0, -1}, mean{1.0 / 3, 1.0 / 3, 1.0 / 3};
  cv::Mat along_x, along_y, result;
  cv::sepFilter2D(luma, along_x, CV_64F, difference, mean, cv::Point(-1, -1), 0, cv::BORDER_REPLICATE);
  cv::sepFilter2D(luma, along_y, CV_64F, mean, difference, cv::Point(-1, -1), 0, cv::BORDER_REPLICATE);
  cv::magnitude(along_x, along_y, result);
  return result;
}

}  // namespace

double gmsd(core::ImageView a, core::ImageView b, core::ImageView mask) {
  const Comparison pair(a, b, mask);
  const cv::Mat first = gradient_magnitude(a), second = gradient_magnitude(b);
  const cv::Mat weights = halved_weights(pair.weights());
  const cv::Mat similarity = (2 * first.mul(second) + kC) / (first.mul(first) + second.mul(second) + kC);
  const double total = cv::sum(weights)[0];
  const double mean = similarity.dot(weights) / total;
  const cv::Mat apart = similarity - mean;
  return std::sqrt(std::max(0.0, apart.mul(apart).dot(weights) / total));
}

}  // namespace lightstage::model
