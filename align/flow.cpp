#include "align/flow.h"

#include <cmath>
#include <opencv2/imgproc.hpp>
#include <opencv2/optflow.hpp>
#include <opencv2/video/tracking.hpp>

#include "align/tone/tone.h"
#include "core/error.h"
#include "core/image_file.h"
#include "core/parallel.h"

namespace lightstage::align {

namespace {

constexpr int kSmallestSide = 16;

// OpenCV reads beyond its buffers when the finest scale is coarser than the coarsest one it chooses, at which the shorter side
// still holds a patch of 8 pixels and the longer one 32.
int finest_scale_for(int wanted, int width, int height) {
  int scale = wanted;
  while (scale > 0 && (std::min(width, height) < (8 << scale) || std::max(width, height) < (32 << scale))) --scale;
  return scale;
}

// Encoded luminance on a scale of 0 to 255, smoothed a little: bilinear sampling between pixels, which the flow search does, is
// then nearly exact, and noise counts less.
cv::Mat_<float> prepared(core::ImageView picture, double white) {
  constexpr double kSmoothingPx = 0.8;
  const core::Image encoded = encoded_luminance(core::to_luminance(picture), white);
  cv::Mat_<float> result(encoded.height(), encoded.width());
  for (int y = 0; y < result.rows; ++y) {
    for (int x = 0; x < result.cols; ++x) result(y, x) = 255 * std::min(encoded(y, x), 1.0F);
  }
  cv::GaussianBlur(result, result, {}, kSmoothingPx, kSmoothingPx, cv::BORDER_REPLICATE);
  return result;
}

cv::Mat_<uchar> rounded(const cv::Mat_<float>& picture) {
  cv::Mat_<uchar> result;
  picture.convertTo(result, CV_8U);
  return result;
}

cv::Ptr<cv::DISOpticalFlow> dense_inverse_search(FlowPreset preset, cv::Size size) {
  cv::Ptr<cv::DISOpticalFlow> dis =
      cv::DISOpticalFlow::create(preset == FlowPreset::kDisUltrafast ? cv::DISOpticalFlow::PRESET_ULTRAFAST
                                 : preset == FlowPreset::kDisFast    ? cv::DISOpticalFlow::PRESET_FAST
                                                                     : cv::DISOpticalFlow::PRESET_MEDIUM);
  const int wanted = preset == FlowPreset::kFine ? 0 : dis->getFinestScale();
  dis->setFinestScale(finest_scale_for(wanted, size.width, size.height));
  return dis;
}

// Between pictures on a scale of 0 to 255.
cv::Mat flow_between(const cv::Mat_<float>& from, const cv::Mat_<float>& to, FlowPreset preset) {
  cv::Mat flow;
  switch (preset) {
    case FlowPreset::kFarneback: {
      constexpr int kLevels = 5, kWindow = 15, kIterations = 5, kNeighbours = 7;
      constexpr double kScale = 0.5, kSigma = 1.5;
      cv::calcOpticalFlowFarneback(rounded(from), rounded(to), flow, kScale, kLevels, kWindow, kIterations, kNeighbours,
                                   kSigma, 0);
      break;
    }
    case FlowPreset::kTvl1:
      // Takes pictures that are not of 8 bits on a scale of 0 to 1.
      cv::optflow::createOptFlow_DualTVL1()->calc(from / 255, to / 255, flow);
      break;
    case FlowPreset::kDeepFlow:
      cv::optflow::createOptFlow_DeepFlow()->calc(from, to, flow);
      break;
    case FlowPreset::kDisUltrafast:
    case FlowPreset::kDisFast:
    case FlowPreset::kDisMedium:
    case FlowPreset::kFine:
      dense_inverse_search(preset, from.size())->calc(rounded(from), rounded(to), flow);
      break;
  }
  if (preset == FlowPreset::kFine) {
    // Twice OpenCV's weights of smoothness and gradient constancy against that of brightness, which changes where the subject turns.
    const cv::Ptr<cv::VariationalRefinement> refinement = cv::VariationalRefinement::create();
    refinement->setFixedPointIterations(10);
    refinement->setSorIterations(10);
    refinement->setAlpha(40);
    refinement->setGamma(20);
    refinement->calc(from, to, flow);
  }
  return flow;
}

// Of pictures that are `times` larger: pixels are squares about their centres.
cv::Mat enlarged(const cv::Mat& flow, int times, cv::Size size) {
  const double scale = 1.0 / times, offset = 0.5 * scale - 0.5;
  const cv::Mat_<double> small_from_large = (cv::Mat_<double>(2, 3) << scale, 0, offset, 0, scale, offset);
  cv::Mat result;
  cv::warpAffine(flow, result, small_from_large, size, cv::INTER_LINEAR | cv::WARP_INVERSE_MAP, cv::BORDER_REPLICATE);
  return result * times;
}

void require_picture(core::ImageView picture, const std::string& what) {
  if (picture.channels() != 1 && picture.channels() != 3) {
    throw core::BadInput(what + ": it must have 1 or 3 channels, not " + std::to_string(picture.channels()));
  }
  core::require_finite(picture, what);
}

// Bilinear; beyond the border as at it.
std::array<double, 2> flow_at(const FlowField& flow, double x, double y) {
  const double in_x = std::clamp(x, 0.0, double(flow.width() - 1)),
               in_y = std::clamp(y, 0.0, double(flow.height() - 1));
  const int left = std::min(int(in_x), std::max(0, flow.width() - 2)),
            top = std::min(int(in_y), std::max(0, flow.height() - 2));
  const int right = std::min(left + 1, flow.width() - 1), bottom = std::min(top + 1, flow.height() - 1);
  const double across = in_x - left, down = in_y - top;
  std::array<double, 2> result;
  for (int c = 0; c < 2; ++c) {
    const double above = (1 - across) * double(flow(top, left, c)) + across * double(flow(top, right, c));
    const double below = (1 - across) * double(flow(bottom, left, c)) + across * double(flow(bottom, right, c));
    result[std::size_t(c)] = (1 - down) * above + down * below;
  }
  return result;
}

}  // namespace

std::string_view name_of(FlowPreset preset) {
  for (const auto& [name, named] : kFlowPresets)
    if (named == preset) return name;
  return "";
}

FlowField compute_flow(core::ImageView reference, core::ImageView other, FlowPreset preset, int shrink) {
  if (reference.width() != other.width() || reference.height() != other.height()) {
    throw core::BadInput("optical flow: the pictures differ in size, " + std::to_string(reference.width()) + " x " +
                         std::to_string(reference.height()) + " and " + std::to_string(other.width()) + " x " +
                         std::to_string(other.height()));
  }
  if (shrink < 1) throw core::BadInput("optical flow: pictures cannot be shrunk " + std::to_string(shrink) + " times");
  if (reference.width() / shrink < kSmallestSide || reference.height() / shrink < kSmallestSide) {
    throw core::BadInput("optical flow: pictures below " + std::to_string(kSmallestSide) + " pixels a side" +
                         (shrink > 1 ? " when shrunk " + std::to_string(shrink) + " times" : ""));
  }
  require_picture(reference, "optical flow, reference picture");
  require_picture(other, "optical flow, other picture");

  const core::Image from = shrink > 1 ? core::shrink_by_box(reference, shrink) : core::Image(reference);
  const core::Image to = shrink > 1 ? core::shrink_by_box(other, shrink) : core::Image(other);
  const double white = white_level(core::to_luminance(from));
  cv::Mat flow = flow_between(prepared(from, white), prepared(to, white), preset);
  if (shrink > 1) flow = enlarged(flow, shrink, {reference.width(), reference.height()});
  FlowField result(flow.rows, flow.cols, 2);
  for (int y = 0; y < flow.rows; ++y) {
    std::copy_n(flow.ptr<float>(y), std::size_t(flow.cols) * 2, result.pixel(y, 0));
  }
  return result;
}

core::Image flow_confidence(const FlowField& forward, const FlowField& backward) {
  if (forward.channels() != 2 || forward.size() != backward.size()) {
    throw core::BadInput("flow confidence: flows there and back need two channels and one size");
  }
  core::require_finite(forward, "flow confidence: the flow there");
  core::require_finite(backward, "flow confidence: the flow back");
  constexpr std::size_t kRowsAtATime = 8;
  core::Image confidence(forward.height(), forward.width(), 1);
  core::parallel_for(std::size_t(forward.height()), kRowsAtATime, [&](std::size_t first, std::size_t last) {
    for (int y = int(first); y < int(last); ++y) {
      for (int x = 0; x < forward.width(); ++x) {
        const double dx = double(forward(y, x, 0)), dy = double(forward(y, x, 1));
        if (x + dx < -0.5 || y + dy < -0.5 || x + dx > forward.width() - 0.5 || y + dy > forward.height() - 0.5)
          continue;
        const auto [back_x, back_y] = flow_at(backward, x + dx, y + dy);
        const double error = (dx + back_x) * (dx + back_x) + (dy + back_y) * (dy + back_y);
        const double tolerance = 0.01 * (dx * dx + dy * dy + back_x * back_x + back_y * back_y) + 0.5;
        confidence(y, x) = float(std::max(0.0, 1 - error / tolerance));
      }
    }
  });
  return confidence;
}

}  // namespace lightstage::align
