#include "align/flow.h"

#include <cmath>
#include <opencv2/imgproc.hpp>
#include <opencv2/video/tracking.hpp>

#include "align/tone/tone.h"
#include "core/error.h"
#include "core/image_file.h"

namespace lightstage::align {

namespace {

constexpr int kSmallestSide = 16;

struct DisSettings {
  int finest_scale;  // flow is computed at 1 / 2^finest_scale of the picture's size
  int patch_stride;
  int descent_iterations;
  int refinement_iterations;
  bool float_refinement;  // a last refinement on pictures that are not rounded to 8 bits
};

DisSettings settings_of(FlowPreset preset) {
  switch (preset) {
    case FlowPreset::kFast:
      return {2, 4, 16, 5, false};
    case FlowPreset::kMedium:
      return {1, 3, 25, 5, false};
    case FlowPreset::kFine:
      break;
  }
  return {0, 3, 25, 5, true};
}

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

void require_picture(core::ImageView picture, const std::string& what) {
  if (picture.channels() != 1 && picture.channels() != 3) {
    throw core::BadInput(what + ": it must have 1 or 3 channels, not " + std::to_string(picture.channels()));
  }
  core::require_finite(picture, what);
}

}  // namespace

FlowField compute_flow(core::ImageView reference, core::ImageView other, FlowPreset preset) {
  if (reference.width() != other.width() || reference.height() != other.height()) {
    throw core::BadInput("optical flow: the pictures differ in size, " + std::to_string(reference.width()) + " x " +
                         std::to_string(reference.height()) + " and " + std::to_string(other.width()) + " x " +
                         std::to_string(other.height()));
  }
  if (reference.width() < kSmallestSide || reference.height() < kSmallestSide) {
    throw core::BadInput("optical flow: pictures below " + std::to_string(kSmallestSide) + " pixels a side");
  }
  require_picture(reference, "optical flow, reference picture");
  require_picture(other, "optical flow, other picture");

  const double white = white_level(core::to_luminance(reference));
  const cv::Mat_<float> from = prepared(reference, white);
  const cv::Mat_<float> to = prepared(other, white);
  cv::Mat_<uchar> from8;
  cv::Mat_<uchar> to8;
  from.convertTo(from8, CV_8U);
  to.convertTo(to8, CV_8U);

  const DisSettings settings = settings_of(preset);
  const cv::Ptr<cv::DISOpticalFlow> dis = cv::DISOpticalFlow::create();
  dis->setFinestScale(finest_scale_for(settings.finest_scale, reference.width(), reference.height()));
  dis->setPatchStride(settings.patch_stride);
  dis->setGradientDescentIterations(settings.descent_iterations);
  dis->setVariationalRefinementIterations(settings.refinement_iterations);
  cv::Mat flow;
  dis->calc(from8, to8, flow);
  if (settings.float_refinement) {
    // Twice OpenCV's weights of smoothness and gradient constancy against that of brightness, which changes where the subject turns.
    const cv::Ptr<cv::VariationalRefinement> refinement = cv::VariationalRefinement::create();
    refinement->setFixedPointIterations(10);
    refinement->setSorIterations(10);
    refinement->setAlpha(40);
    refinement->setGamma(20);
    refinement->calc(from, to, flow);
  }
  FlowField result(flow.rows, flow.cols, 2);
  for (int y = 0; y < flow.rows; ++y) {
    std::copy_n(flow.ptr<float>(y), std::size_t(flow.cols) * 2, result.pixel(y, 0));
  }
  return result;
}

}  // namespace lightstage::align
