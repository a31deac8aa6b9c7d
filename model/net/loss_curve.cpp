#include "model/net/loss_curve.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <opencv2/imgproc.hpp>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "core/text.h"

namespace lightstage::model {
namespace {

constexpr int kWidth = 960, kHeight = 540;
constexpr int kLeft = 90, kRight = 20, kTop = 50, kBottom = 60;                    // margins around the plot
const cv::Scalar kWhite(255, 255, 255), kBlack(30, 30, 30), kGrid(225, 225, 225);  // red, green, blue
const cv::Scalar kTrain(40, 110, 190), kValidation(210, 80, 30), kGuide(110, 110, 110);

// 1, 2 or 5 times a power of ten, for about `count` ticks over a range.
double tick_step(double range, int count) {
  const double rough = range / count;
  const double power = std::pow(10, std::floor(std::log10(rough)));
  for (const double factor : {1.0, 2.0, 5.0}) {
    if (factor * power >= rough) return factor * power;
  }
  return 10 * power;
}

class Plot {
 public:
  Plot(double last_step, double lowest, double highest)
      : canvas_(kHeight, kWidth, CV_8UC3, kWhite),
        last_step_(std::max(last_step, 1.0)),
        // A little air, and never an empty range.
        bottom_(std::log10(lowest) - 0.05),
        top_(std::log10(highest) + 0.05) {
    draw_error_axis();
    draw_step_axis();
    cv::rectangle(canvas_, {kLeft, kTop}, {kWidth - kRight, kHeight - kBottom}, kBlack, 1, cv::LINE_AA);
  }

  void curve(const std::vector<std::pair<double, double>>& points, const cv::Scalar& colour, const std::string& name) {
    std::optional<cv::Point> before;
    for (const auto& [step, error] : points) {
      const cv::Point at(x(step), y(error));
      if (before) cv::line(canvas_, *before, at, colour, 2, cv::LINE_AA);
      cv::circle(canvas_, at, 2, colour, cv::FILLED, cv::LINE_AA);
      before = at;
    }
    legend(colour, name);
  }

  void level(double error, const cv::Scalar& colour, const std::string& name) {
    constexpr int kDash = 8;
    for (int at = kLeft; at < kWidth - kRight; at += 2 * kDash) {
      cv::line(canvas_, {at, y(error)}, {std::min(at + kDash, kWidth - kRight), y(error)}, colour, 1, cv::LINE_AA);
    }
    legend(colour, name);
  }

  core::Image image() const {
    core::Image result(kHeight, kWidth, 3);
    const cv::Mat continuous = canvas_.reshape(1, 1);
    std::transform(continuous.begin<uchar>(), continuous.end<uchar>(), result.values().begin(),
                   [](uchar value) { return float(value) / 255; });
    return result;
  }

 private:
  int x(double step) const { return kLeft + int(std::lround(step / last_step_ * (kWidth - kLeft - kRight))); }
  int y(double error) const {
    const double height = (std::log10(error) - bottom_) / (top_ - bottom_);
    return kHeight - kBottom - int(std::lround(height * (kHeight - kTop - kBottom)));
  }

  void text(const std::string& words, cv::Point at, const cv::Scalar& colour = kBlack) {
    cv::putText(canvas_, words, at, cv::FONT_HERSHEY_SIMPLEX, 0.5, colour, 1, cv::LINE_AA);
  }

  void draw_error_axis() {
    const auto line_at = [&](double error) {
      if (std::log10(error) < bottom_ || std::log10(error) > top_) return;
      cv::line(canvas_, {kLeft, y(error)}, {kWidth - kRight, y(error)}, kGrid, 1);
      text(core::number_text(error, 3), {12, y(error) + 5});
    };
    const double lowest = std::pow(10, bottom_), highest = std::pow(10, top_);
    if (top_ - bottom_ < 1) {  // powers of ten might all lie outside
      const double step = tick_step(highest - lowest, 7);
      for (double at = std::ceil(lowest / step) * step; at <= highest; at += step) line_at(at);
    } else {
      for (double power = std::pow(10, std::floor(bottom_)); power <= highest; power *= 10) {
        for (const double digit : {1, 2, 5}) line_at(digit * power);
      }
    }
    text("error (L1)", {12, kTop - 18});
  }

  void draw_step_axis() {
    const double step = std::max(1.0, tick_step(last_step_, 8));
    for (double at = 0; at <= last_step_; at += step) {
      cv::line(canvas_, {x(at), kTop}, {x(at), kHeight - kBottom}, kGrid, 1);
      text(core::number_text(at), {x(at) - 12, kHeight - kBottom + 20});
    }
    text("step", {(kLeft + kWidth - kRight) / 2, kHeight - 14});
  }

  void legend(const cv::Scalar& colour, const std::string& name) {
    cv::line(canvas_, {legend_x_, kTop - 23}, {legend_x_ + 24, kTop - 23}, colour, 2, cv::LINE_AA);
    text(name, {legend_x_ + 30, kTop - 18}, colour);
    legend_x_ += 160;
  }

  cv::Mat canvas_;
  double last_step_, bottom_, top_;  // of the logarithms of errors
  int legend_x_ = kLeft + 160;
};

}  // namespace

std::string loss_curve_csv(std::span<const LossPoint> curve, double first_validation) {
  std::string text = "step,seconds,train_l1,validation_l1,level\n0,0,," + core::number_text(first_validation) + ",0\n";
  for (const LossPoint& p : curve) {
    text += std::to_string(p.step) + "," + core::number_text(p.seconds, 6) + "," + core::number_text(p.train) + "," +
            core::number_text(p.validation) + "," + core::number_text(p.level, 4) + "\n";
  }
  return text;
}

core::Image draw_loss_curve(std::span<const LossPoint> curve, double first_validation, double guide_validation) {
  double lowest = std::numeric_limits<double>::infinity(), highest = 0;
  const auto drawable = [&](double error) {
    if (!std::isfinite(error) || !(error > 0)) return false;
    lowest = std::min(lowest, error);
    highest = std::max(highest, error);
    return true;
  };
  std::vector<std::pair<double, double>> train, validation;
  if (drawable(first_validation)) validation.emplace_back(0.0, first_validation);
  for (const LossPoint& point : curve) {
    if (drawable(point.train)) train.emplace_back(double(point.step), point.train);
    if (drawable(point.validation)) validation.emplace_back(double(point.step), point.validation);
  }
  const bool has_guide = drawable(guide_validation);
  if (highest == 0) lowest = highest = 1;

  Plot plot(curve.empty() ? 1 : double(curve.back().step), lowest, highest);
  plot.curve(train, kTrain, "train");
  plot.curve(validation, kValidation, "validation");
  if (has_guide) plot.level(guide_validation, kGuide, "validation, rbf");
  return plot.image();
}

}  // namespace lightstage::model
