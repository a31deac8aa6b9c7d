#include "model/metrics.h"

#include <cmath>
#include <cstdint>
#include <opencv2/quality/qualityssim.hpp>
#include <string>
#include <vector>

#include "core/error.h"
#include "core/parallel.h"
#include "model/flip.h"

namespace lightstage::model {

namespace {

constexpr std::size_t kRowsAtATime = 16;

std::string text_of(core::ImageSize size) {
  return std::to_string(size.width) + "x" + std::to_string(size.height) + "x" + std::to_string(size.channels);
}

// Two pictures and where they are compared.
struct Comparison {
  core::ImageView a, b, mask;
  std::size_t values = 0;  // masked pixels times channels

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
};

double squared(double v) {
  return v * v;
}

// The pixels in float64, scaled to 0..255, for which OpenCV's SSIM has its constants C1 = (0.01 255)^2 and C2
// = (0.03 255)^2.
cv::Mat in_code_values(core::ImageView image) {
  cv::Mat result(image.height(), image.width(), CV_64FC(image.channels()));
  for (int y = 0; y < image.height(); ++y) {
    double* to = result.ptr<double>(y);
    const float* from = image.row(y);
    for (int i = 0; i < image.width() * image.channels(); ++i) to[i] = 255.0 * double(from[i]);
  }
  return result;
}

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
  cv::quality::QualitySSIM::compute(in_code_values(a), in_code_values(b), map);
  map.convertTo(map, CV_64F);
  return pair.mean([&](int y, int x, int c) { return (1 - map.ptr<double>(y)[x * a.channels() + c]) / 2; });
}

double flip(core::ImageView a, core::ImageView b, core::ImageView mask) {
  const Comparison pair(a, b, mask);
  const core::Image map = flip_map(a, b);
  return pair.mean([&](int y, int x, int) { return double(map(y, x)); });
}

}  // namespace lightstage::model
