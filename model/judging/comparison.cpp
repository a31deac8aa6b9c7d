#include "model/judging/comparison.h"

#include <opencv2/imgproc.hpp>

namespace lightstage::model {

namespace {

cv::Mat box_means(const cv::Mat& picture, int border) {
  cv::Mat even, result;
  cv::copyMakeBorder(picture, even, 0, picture.rows % 2, 0, picture.cols % 2, border);
  cv::resize(even, result, cv::Size(even.cols / 2, even.rows / 2), 0, 0, cv::INTER_AREA);
  return result;
}

}  // namespace

cv::Mat float64_mat(core::ImageView image, double factor) {
  cv::Mat result(image.height(), image.width(), CV_64FC(image.channels()));
  for (int y = 0; y < image.height(); ++y) {
    double* to = result.ptr<double>(y);
    const float* from = image.row(y);
    for (int i = 0; i < image.width() * image.channels(); ++i) to[i] = factor * double(from[i]);
  }
  return result;
}

// A row that is repeated leaves the mean of its box as it is.
cv::Mat halved(const cv::Mat& picture) {
  return box_means(picture, cv::BORDER_REPLICATE);
}

cv::Mat halved_weights(const cv::Mat& weights) {
  return 4 * box_means(weights, cv::BORDER_CONSTANT);
}

}  // namespace lightstage::model
