// Wang, Simoncelli and Bovik 2003, "Multi-scale structural similarity for image quality assessment".
#include <algorithm>
#include <array>
#include <cmath>
#include <opencv2/imgproc.hpp>

#include "model/judging/comparison.h"
#include "model/metrics.h"

namespace lightstage::model {

namespace {

constexpr std::array<double, 5> kExponents{0.0448, 0.2856, 0.3001, 0.2363, 0.1333};  // section 3.2, finest scale first
constexpr int kWindow = 11;
constexpr double kSigma = 1.5;
constexpr double kC1 = 0.01 * 0.01, kC2 = 0.03 * 0.03;

std::size_t scales_of(int height, int width) {
  std::size_t scales = 1;
  for (int side = std::min(height, width); scales < kExponents.size() && (side + 1) / 2 >= kWindow; ++scales)
    side = (side + 1) / 2;
  return scales;
}

cv::Mat windowed(const cv::Mat& values) {
  cv::Mat result;
  cv::GaussianBlur(values, result, cv::Size(kWindow, kWindow), kSigma, kSigma, cv::BORDER_REFLECT_101);
  return result;
}

// Weighted means over the picture, a channel each.
struct Similarity {
  std::vector<double> contrast_structure, whole;
};

Similarity similarity(const cv::Mat& a, const cv::Mat& b, const cv::Mat& weights) {
  const cv::Mat mean_a = windowed(a), mean_b = windowed(b);
  const cv::Mat aa = windowed(a.mul(a)), bb = windowed(b.mul(b)), ab = windowed(a.mul(b));
  const std::size_t channels = std::size_t(a.channels());
  Similarity sums{std::vector<double>(channels), std::vector<double>(channels)};
  double total = 0;
  for (int y = 0; y < a.rows; ++y) {
    for (int x = 0; x < a.cols; ++x) {
      const double weight = weights.at<double>(y, x);
      if (weight == 0) continue;
      total += weight;
      for (std::size_t c = 0; c < channels; ++c) {
        const std::size_t i = std::size_t(x) * channels + c;
        const double ma = mean_a.ptr<double>(y)[i], mb = mean_b.ptr<double>(y)[i];
        const double variances = aa.ptr<double>(y)[i] - ma * ma + bb.ptr<double>(y)[i] - mb * mb;
        const double covariance = ab.ptr<double>(y)[i] - ma * mb;
        const double contrast_structure = (2 * covariance + kC2) / (variances + kC2);
        sums.contrast_structure[c] += weight * contrast_structure;
        sums.whole[c] += weight * contrast_structure * (2 * ma * mb + kC1) / (ma * ma + mb * mb + kC1);
      }
    }
  }
  for (std::size_t c = 0; c < channels; ++c) {
    sums.contrast_structure[c] /= total;
    sums.whole[c] /= total;
  }
  return sums;
}

}  // namespace

double ms_ssim(core::ImageView a, core::ImageView b, core::ImageView mask) {
  const Comparison pair(a, b, mask);
  const std::size_t scales = scales_of(a.height(), a.width());
  double exponents = 0;
  for (std::size_t scale = 0; scale < scales; ++scale) exponents += kExponents[scale];
  cv::Mat first = float64_mat(a), second = float64_mat(b), weights = pair.weights();
  std::vector<double> products(std::size_t(a.channels()), 1.0);
  for (std::size_t scale = 0; scale < scales; ++scale) {
    const Similarity similar = similarity(first, second, weights);
    const bool coarsest = scale + 1 == scales;
    for (std::size_t c = 0; c < products.size(); ++c) {
      const double term = coarsest ? similar.whole[c] : similar.contrast_structure[c];
      products[c] *= std::pow(std::max(0.0, term), kExponents[scale] / exponents);
    }
    if (coarsest) break;
    first = halved(first);
    second = halved(second);
    weights = halved_weights(weights);
  }
  double sum = 0;
  for (const double product : products) sum += product;
  return sum / double(products.size());
}

}  // namespace lightstage::model
