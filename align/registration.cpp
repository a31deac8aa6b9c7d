#include "align/registration.h"

#include <algorithm>
#include <cmath>
#include <optional>

#include <opencv2/imgproc.hpp>
#include <opencv2/video/tracking.hpp>

#include "align/tone/tone.h"
#include "core/error.h"
#include "core/image_file.h"
#include "core/parallel.h"
#include "core/sphere.h"

namespace lightstage::align {

namespace {

constexpr int kWorkingSide = 384;
constexpr int kSmallestSide = 32;
constexpr std::size_t kNeighbours = 8;
// The width over which contrast is local, as a share of the longer side, round by round: coarse to catch what moved far, then fine, since
// of what is wide most is shading, which moves with the light. Every round more lets light and motion be confused further.
constexpr double kWindows[] = {0.04, 0.01, 0.01, 0.01};
// Motion beyond this share of the longer side is not drift.
constexpr double kFarthest = 0.08;
constexpr double kLeastCorrelation = 0.25;
// Of the residual; where more is left, what was found is what wandering shadows look like, not motion.
constexpr double kMostLeft = 0.9;

struct Contrast {
  cv::Mat_<float> picture;  // about 0, mostly within -3 to 3
  cv::Mat_<uchar> lit;      // not 0 where there is light to see by
};

Contrast local_contrast(const core::Image& luminance, double window_share) {
  constexpr float kDarkest = 0.01F;  // of white: below, noise is all there is
  constexpr double kLeastDeviation = 0.05;
  constexpr double kLeastWindow = 4;  // pixels
  const double white = white_level(luminance);
  const double window = std::max(kLeastWindow, window_share * std::max(luminance.width(), luminance.height()));
  cv::Mat_<float> log(luminance.height(), luminance.width());
  Contrast contrast;
  contrast.lit.create(log.size());
  for (int y = 0; y < log.rows; ++y) {
    for (int x = 0; x < log.cols; ++x) {
      const float value = std::min(1.0F, float(double(luminance(y, x)) / white));
      log(y, x) = std::log(std::max(value, 0.0F) + kDarkest);
      contrast.lit(y, x) = value > 2 * kDarkest ? 255 : 0;
    }
  }
  cv::GaussianBlur(log, log, {}, 1.0);
  cv::Mat_<float> mean, variance;
  cv::GaussianBlur(log, mean, {}, window);
  log -= mean;
  cv::GaussianBlur(log.mul(log), variance, {}, window);
  cv::sqrt(variance + kLeastDeviation * kLeastDeviation, variance);
  contrast.picture = log / variance;
  return contrast;
}

// Motions here are of the working size.
cv::Mat_<float> matrix_of(const RigidMotion& motion, cv::Size size) {
  const double c = std::cos(motion.radians), s = std::sin(motion.radians);
  const double x = 0.5 * (size.width - 1), y = 0.5 * (size.height - 1);
  return (cv::Mat_<float>(2, 3) << float(c), float(-s), float(x - c * x + s * y + motion.dx), float(s), float(c),
          float(y - s * x - c * y + motion.dy));
}

RigidMotion motion_of(const cv::Mat_<float>& matrix, cv::Size size) {
  const double x = 0.5 * (size.width - 1), y = 0.5 * (size.height - 1);
  const auto at = [&](int row, int column) { return double(matrix(row, column)); };
  return {at(0, 0) * x + at(0, 1) * y + at(0, 2) - x, at(1, 0) * x + at(1, 1) * y + at(1, 2) - y,
          std::atan2(at(1, 0), at(0, 0))};
}

cv::Mat moved(const cv::Mat& picture, const RigidMotion& motion, int how) {
  cv::Mat result;
  cv::warpAffine(picture, result, matrix_of(motion, picture.size()), picture.size(), how | cv::WARP_INVERSE_MAP,
                 cv::BORDER_REPLICATE);
  return result;
}

// Where both are lit, over what lies away from the border.
double correlation(const cv::Mat_<float>& a, const cv::Mat_<float>& b, const cv::Mat_<uchar>& lit) {
  double ab = 0, aa = 0, bb = 0;
  const int border = std::max(a.cols, a.rows) / 32;
  for (int y = border; y < a.rows - border; ++y) {
    for (int x = border; x < a.cols - border; ++x) {
      if (lit(y, x) == 0) continue;
      const double u = double(a(y, x)), v = double(b(y, x));
      ab += u * v;
      aa += u * u;
      bb += v * v;
    }
  }
  return aa > 0 && bb > 0 ? ab / std::sqrt(aa * bb) : 0;
}

// Median length of the flow between two pictures of contrast where there is light: a measure that does not know of rigid motions.
double flow_length(const cv::Mat_<float>& expected, const cv::Mat_<float>& seen, const cv::Mat_<uchar>& lit) {
  const auto rounded = [](const cv::Mat_<float>& contrast) {
    cv::Mat_<uchar> result;
    contrast.convertTo(result, CV_8U, 40, 128);
    return result;
  };
  const cv::Ptr<cv::DISOpticalFlow> dis = cv::DISOpticalFlow::create(cv::DISOpticalFlow::PRESET_MEDIUM);
  dis->setFinestScale(0);
  cv::Mat_<cv::Vec2f> flow;
  dis->calc(rounded(expected), rounded(seen), flow);
  std::vector<float> lengths;
  const int border = std::max(flow.cols, flow.rows) / 32;
  for (int y = border; y < flow.rows - border; ++y)
    for (int x = border; x < flow.cols - border; ++x)
      if (lit(y, x) != 0) lengths.push_back(std::hypot(flow(y, x)[0], flow(y, x)[1]));
  return lengths.empty() ? 0 : core::quantile(lengths, 0.5);
}

class Group {
 public:
  Group(const std::function<core::Image(std::size_t)>& picture, std::span<const core::Direction> lights)
      : lights_(lights.begin(), lights.end()),
        pictures_(lights.size()),
        contrasts_(lights.size()),
        motions_(lights.size()) {
    const core::ImageSize size = picture(0).size();
    if (std::min(size.width, size.height) < kSmallestSide) {
      throw core::BadInput("registration: pictures below " + std::to_string(kSmallestSide) + " pixels a side");
    }
    shrink_ = std::max(1, (std::max(size.width, size.height) + kWorkingSide - 1) / kWorkingSide);
    each([&](std::size_t i) {
      const core::Image image = picture(i);
      const std::string what = "registration: picture " + std::to_string(i);
      if (image.width() != size.width || image.height() != size.height) {
        throw core::BadInput(what + " is of another size than the first");
      }
      core::require_finite(image, what);
      pictures_[i] = core::to_luminance(core::shrink_by_box(image, shrink_));
    });
    size_ = {pictures_.front().width(), pictures_.front().height()};
  }

  std::vector<Registered> run() {
    std::vector<Registered> result(lights_.size());
    if (lights_.size() < 3) return result;
    std::vector<std::string> objections;
    double window = 0;
    for (const double next_window : kWindows) {
      if (next_window != window) {
        window = next_window;
        each([&](std::size_t i) { contrasts_[i] = local_contrast(pictures_[i], window); });
      }
      std::vector<RigidMotion> next(lights_.size());
      objections.assign(lights_.size(), {});
      each([&](std::size_t i) { next[i] = registered(i, objections[i]); });
      centre(next);
      motions_ = next;
    }
    const std::vector<RigidMotion> found = motions_;
    each([&](std::size_t i) {
      const cv::Mat_<float> expected = expected_of(i);
      const cv::Mat_<float> here = moved(contrasts_[i].picture, found[i], cv::INTER_CUBIC);
      const cv::Mat_<uchar> lit = moved(contrasts_[i].lit, found[i], cv::INTER_NEAREST);
      result[i].correlation_after = correlation(expected, here, lit);
      result[i].residual_after_px = shrink_ * flow_length(expected, here, lit);
      result[i].motion = {found[i].dx * shrink_, found[i].dy * shrink_, found[i].radians};
      result[i].objection = objections[i];
      if (objections[i].empty() && result[i].correlation_after < kLeastCorrelation) {
        result[i].objection = "does not resemble the pictures of the lights beside its own";
      }
    });
    motions_.assign(lights_.size(), {});
    measure_in_place(result);
    if (!improved(result)) stay(result);
    return result;
  }

 private:
  void measure_in_place(std::vector<Registered>& result) const {
    each([&](std::size_t i) {
      const cv::Mat_<float> expected = expected_of(i);
      result[i].correlation_before = correlation(expected, contrasts_[i].picture, contrasts_[i].lit);
      result[i].residual_before_px = shrink_ * flow_length(expected, contrasts_[i].picture, contrasts_[i].lit);
    });
  }

  static bool improved(const std::vector<Registered>& pictures) {
    std::vector<float> before, after;
    for (const Registered& picture : pictures) {
      if (!picture.objection.empty()) continue;
      before.push_back(float(picture.residual_before_px));
      after.push_back(float(picture.residual_after_px));
    }
    return !before.empty() && core::quantile(after, 0.5) < kMostLeft * core::quantile(before, 0.5);
  }

  static void stay(std::vector<Registered>& pictures) {
    for (Registered& picture : pictures) {
      picture.motion = {};
      picture.residual_after_px = picture.residual_before_px;
      picture.correlation_after = picture.correlation_before;
    }
  }

  template <typename Work>
  void each(const Work& work) const {
    core::parallel_for(lights_.size(), 1, [&](std::size_t first, std::size_t last) {
      for (std::size_t i = first; i < last; ++i) work(i);
    });
  }

  // What the neighbours look like in the common pose.
  cv::Mat_<float> expected_of(std::size_t i) const {
    const std::vector<std::size_t> nearest =
        core::nearest_indices(lights_, lights_[i], std::min(kNeighbours + 1, lights_.size()));
    const double reach = core::angle_radians(lights_[i], lights_[nearest.back()]);
    cv::Mat_<float> sum(size_, 0.0F), weights(size_, 1e-6F);
    for (const std::size_t j : nearest) {
      if (j == i) continue;
      const double angle = core::angle_radians(lights_[i], lights_[j]);
      const double weight = reach > 0 ? std::exp(-angle * angle / (reach * reach)) : 1;
      cv::Mat_<float> lit;
      moved(contrasts_[j].lit, motions_[j], cv::INTER_LINEAR).convertTo(lit, CV_32F, weight / 255);
      sum += moved(contrasts_[j].picture, motions_[j], cv::INTER_CUBIC).mul(lit);
      weights += lit;
    }
    return sum / weights;
  }

  RigidMotion registered(std::size_t i, std::string& objection) const {
    constexpr int kIterations = 60;
    constexpr double kEnough = 1e-6;
    constexpr int kFilter = 3;
    cv::Mat matrix = matrix_of(motions_[i], size_);
    if (cv::countNonZero(contrasts_[i].lit) < 256) {
      objection = "is too dark to be registered";
      return {};
    }
    try {
      cv::findTransformECC(expected_of(i), contrasts_[i].picture, matrix, cv::MOTION_EUCLIDEAN,
                           {cv::TermCriteria::COUNT | cv::TermCriteria::EPS, kIterations, kEnough}, contrasts_[i].lit,
                           kFilter);
    } catch (const cv::Exception&) {  // it does not converge: pictures without anything in common, or without contrast
      objection = "has no contrast in common with the pictures of the lights beside its own";
      return {};
    }
    const RigidMotion motion = motion_of(matrix, size_);
    const double farthest = kFarthest * std::max(size_.width, size_.height);
    if (!std::isfinite(motion.dx + motion.dy + motion.radians) ||
        std::hypot(motion.dx, motion.dy) + std::abs(motion.radians) * 0.5 * size_.width > farthest) {
      objection = "would have to move farther than drift explains";
      return {};
    }
    return motion;
  }

  // The mean of all does not move. Motions are small enough to be added up.
  static void centre(std::vector<RigidMotion>& motions) {
    RigidMotion mean;
    for (const RigidMotion& motion : motions) {
      mean.dx += motion.dx / double(motions.size());
      mean.dy += motion.dy / double(motions.size());
      mean.radians += motion.radians / double(motions.size());
    }
    for (RigidMotion& motion : motions) {
      motion.dx -= mean.dx;
      motion.dy -= mean.dy;
      motion.radians -= mean.radians;
    }
  }

  std::vector<core::Direction> lights_;
  std::vector<core::Image> pictures_;  // luminance, of the working size
  std::vector<Contrast> contrasts_;    // of the round's window
  std::vector<RigidMotion> motions_;
  cv::Size size_;
  int shrink_ = 1;
};

}  // namespace

FlowField RigidMotion::flow(int height, int width) const {
  FlowField result(height, width, 2);
  const double c = std::cos(radians), s = std::sin(radians);
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      const double from_x = x - 0.5 * (width - 1), from_y = y - 0.5 * (height - 1);
      result(y, x, 0) = float(c * from_x - s * from_y - from_x + dx);
      result(y, x, 1) = float(s * from_x + c * from_y - from_y + dy);
    }
  }
  return result;
}

std::vector<Registered> register_pictures(const std::function<core::Image(std::size_t)>& picture,
                                          std::span<const core::Direction> lights) {
  if (lights.empty()) return {};
  return Group(picture, lights).run();
}

}  // namespace lightstage::align
