// Two pictures and the mask over which they are compared.
#pragma once

#include <cstddef>
#include <opencv2/core.hpp>
#include <string>
#include <vector>

#include "core/error.h"
#include "core/image.h"
#include "core/parallel.h"

namespace lightstage::model {

struct Comparison {
  core::ImageView a, b, mask;
  std::size_t values = 0;  // masked pixels times channels

  // Throws BadInput when the sizes differ, or no pixel is inside the mask (empty: all are; otherwise where it is above 0.5).
  Comparison(core::ImageView first, core::ImageView second, core::ImageView where) : a(first), b(second), mask(where) {
    if (a.size() != b.size())
      throw core::BadInput("pictures of " + text_of(a.size()) + " and " + text_of(b.size()) + " cannot be compared");
    if (!mask.empty() && mask.size() != core::ImageSize{a.height(), a.width(), 1})
      throw core::BadInput("a mask of " + text_of(mask.size()) + " does not fit pictures of " + text_of(a.size()));
    for (int y = 0; y < a.height(); ++y)
      for (int x = 0; x < a.width(); ++x)
        if (inside(y, x)) values += std::size_t(a.channels());
    if (values == 0) throw core::BadInput("nothing to compare: no pixel is inside the mask");
  }

  bool inside(int y, int x) const { return mask.empty() || mask(y, x) > 0.5f; }
  double error(int y, int x, int c) const { return double(a(y, x, c)) - double(b(y, x, c)); }

  // The mean over masked values of what term(y, x, c) gives for each. Rows are summed one by one and then
  // together, so the result does not depend on the thread count.
  template <class Term>
  double mean(const Term& term) const {
    constexpr std::size_t kRowsAtATime = 16;
    std::vector<double> row_sums(std::size_t(a.height()), 0.0);
    core::parallel_for(row_sums.size(), kRowsAtATime, [&](std::size_t first, std::size_t last) {
      for (std::size_t row = first; row < last; ++row) {
        const int y = static_cast<int>(row);
        for (int x = 0; x < a.width(); ++x) {
          if (!inside(y, x)) continue;
          for (int c = 0; c < a.channels(); ++c) row_sums[row] += term(y, x, c);
        }
      }
    });
    double sum = 0;
    for (const double row_sum : row_sums) sum += row_sum;
    return sum / double(values);
  }

  // 1 inside, 0 outside, one channel of float64.
  cv::Mat weights() const {
    cv::Mat result(a.height(), a.width(), CV_64F);
    for (int y = 0; y < a.height(); ++y)
      for (int x = 0; x < a.width(); ++x) result.at<double>(y, x) = inside(y, x) ? 1 : 0;
    return result;
  }

 private:
  static std::string text_of(core::ImageSize size) {
    return std::to_string(size.width) + "x" + std::to_string(size.height) + "x" + std::to_string(size.channels);
  }
};

// The picture times `factor`, in float64.
cv::Mat float64_mat(core::ImageView image, double factor = 1);

// Means over boxes of 2 x 2 pixels; sizes are rounded up, and the last boxes hold one row or column where the size is odd.
cv::Mat halved(const cv::Mat& picture);
// Sums over the same boxes: of weights.
cv::Mat halved_weights(const cv::Mat& weights);

}  // namespace lightstage::model
