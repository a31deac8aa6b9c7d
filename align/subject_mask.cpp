#include "align/subject_mask.h"

#include <opencv2/imgproc.hpp>

#include "align/tone/tone.h"
#include "core/display.h"
#include "core/image_file.h"

namespace lightstage::align {

namespace {

// 0 is black, 255 the white level of align/tone.
cv::Mat_<uchar> encoded_8_bit(core::ImageView picture) {
  const core::Image luminance = core::to_luminance(picture);
  const core::Image encoded = encoded_luminance(luminance, white_level(luminance));
  cv::Mat_<uchar> result(encoded.height(), encoded.width());
  for (int y = 0; y < result.rows; ++y) {
    for (int x = 0; x < result.cols; ++x) result(y, x) = cv::saturate_cast<uchar>(255 * encoded(y, x));
  }
  // Noise is strongest where the encoding is steepest, in the dark background.
  cv::medianBlur(result, result, 3);
  return result;
}

struct Level {
  double median = 0;
  double deviation = 0;  // robust standard deviation
};

Level level_where(const cv::Mat_<uchar>& picture, const cv::Mat_<uchar>& mask) {
  std::array<std::size_t, 256> counts{};
  std::size_t total = 0;
  for (int y = 0; y < picture.rows; ++y) {
    for (int x = 0; x < picture.cols; ++x) {
      if (mask(y, x) == 0) continue;
      ++counts[picture(y, x)];
      ++total;
    }
  }
  const auto value_at = [&](double share) {
    std::size_t below = 0;
    for (std::size_t v = 0; v < counts.size(); ++v) {
      below += counts[v];
      if (double(below) >= share * double(total)) return double(v);
    }
    return 255.0;
  };
  // The part of a normal distribution between its quartiles is 1.349 standard deviations wide.
  return {value_at(0.5), (value_at(0.75) - value_at(0.25)) / 1.349};
}

// The connected parts that are not small against the largest, holes filled; nothing where most of the mask is in small
// parts, as that of mere noise is.
cv::Mat_<uchar> large_parts_filled(const cv::Mat_<uchar>& mask) {
  constexpr double kLeastShareOfLargest = 0.1;  // a hand beside the head
  constexpr double kLeastShareInLargest = 0.3;
  cv::Mat labels_any;
  cv::Mat stats;
  cv::Mat centroids;
  const int count = cv::connectedComponentsWithStats(mask, labels_any, stats, centroids, 8, CV_32S);
  const cv::Mat_<int> labels = labels_any;
  int largest = 0;
  for (int i = 1; i < count; ++i) largest = std::max(largest, stats.at<int>(i, cv::CC_STAT_AREA));
  cv::Mat_<uchar> kept = cv::Mat_<uchar>::zeros(mask.size());
  if (largest < kLeastShareInLargest * cv::countNonZero(mask)) return kept;
  for (int y = 0; y < mask.rows; ++y) {
    for (int x = 0; x < mask.cols; ++x) {
      const int label = labels(y, x);
      kept(y, x) = label > 0 && stats.at<int>(label, cv::CC_STAT_AREA) >= kLeastShareOfLargest * largest ? 255 : 0;
    }
  }
  std::vector<std::vector<cv::Point>> contours;
  cv::findContours(kept, contours, cv::RETR_EXTERNAL, cv::CHAIN_APPROX_NONE);
  cv::drawContours(kept, contours, -1, cv::Scalar(255), cv::FILLED);
  return kept;
}

core::Image everywhere(core::ImageView picture) {
  core::Image mask(picture.height(), picture.width(), 1);
  std::fill(mask.values().begin(), mask.values().end(), 1.0F);
  return mask;
}

}  // namespace

core::Image subject_mask(core::ImageView full_on) {
  constexpr double kLeastContrastInDeviations = 6;
  constexpr double kShareOfContrast = 0.25;  // dark hair lies nearer the background than the middle
  constexpr double kNoiseMargin = 4;
  core::require_finite(full_on, "full-on picture");
  if (full_on.empty()) return {};
  const cv::Mat_<uchar> picture = encoded_8_bit(full_on);
  cv::Mat_<uchar> bright;
  const double otsu = cv::threshold(picture, bright, 0, 255, cv::THRESH_BINARY | cv::THRESH_OTSU);
  if (cv::countNonZero(bright) == 0) return everywhere(full_on);
  const Level background = level_where(picture, bright == 0);
  const Level subject = level_where(picture, bright);
  const double contrast = subject.median - background.median;
  const double largest_background =
      255 * double(core::display_encode(float(kBrightestBackground))) * (subject.median / 255);
  if (contrast < kLeastContrastInDeviations * background.deviation || background.median > largest_background) {
    return everywhere(full_on);
  }
  const double threshold =
      std::min(otsu, background.median +
                         std::max(kShareOfContrast * contrast, kNoiseMargin * std::max(1.0, background.deviation)));
  const cv::Mat_<uchar> kept = large_parts_filled(picture > threshold);
  if (cv::countNonZero(kept) == 0) return everywhere(full_on);
  core::Image mask(full_on.height(), full_on.width(), 1);
  for (int y = 0; y < kept.rows; ++y) {
    for (int x = 0; x < kept.cols; ++x) mask(y, x) = kept(y, x) != 0 ? 1.0F : 0.0F;
  }
  return mask;
}

}  // namespace lightstage::align
