#include "calib/outline/edge.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace lightstage::calib {

namespace {

constexpr double kOffsetStepPx = 0.25;

double dot(std::span<const double> a, std::span<const double> b) {
  double sum = 0;
  for (std::size_t i = 0; i < a.size(); ++i) sum += a[i] * b[i];
  return sum;
}

// Share of a Gaussian of width `blur` about 0 that lies below `depth`.
double blurred_step(double depth, double blur) {
  return 0.5 * std::erfc(-depth / (blur * std::numbers::sqrt2));
}

// sqrt(max(depth, 0)) blurred by a Gaussian, by the trapezoidal rule over four of its widths to either side.
// With d = t^2 the root's kink at 0 is gone: integral of t g(depth - t^2) 2 t dt.
double blurred_root(double depth, double blur) {
  constexpr int kSteps = 64;
  const double reach = depth + 5 * blur;
  if (reach <= 0) return 0;
  const double last = std::sqrt(reach);
  const double first = std::sqrt(std::max(0.0, depth - 5 * blur));
  const double step = (last - first) / kSteps;
  double sum = 0;
  for (int i = 0; i <= kSteps; ++i) {
    const double t = first + i * step;
    const double z = (depth - t * t) / blur;
    sum += (i == 0 || i == kSteps ? 0.5 : 1.0) * 2 * t * t * std::exp(-0.5 * z * z);
  }
  return sum * step / (blur * std::sqrt(2 * std::numbers::pi));
}

}  // namespace

RimModel::RimModel(double radius_px, double blur_px, double half_width_px, double search_px)
    : sample_count_(2 * static_cast<int>(half_width_px / kSampleStepPx) + 1) {
  const auto n = std::size_t(sample_count_);
  const int reach = static_cast<int>(search_px / kOffsetStepPx);
  for (int k = -reach; k <= reach; ++k) {
    Candidate c{k * kOffsetStepPx, {}, {}};
    for (std::vector<double>& b : c.basis) b.resize(n);
    for (std::size_t i = 0; i < n; ++i) {
      const double depth = c.offset_px - (double(i) - double(n / 2)) * kSampleStepPx;
      c.basis[0][i] = 1;
      c.basis[1][i] = blurred_step(depth, blur_px);
      c.basis[2][i] = blurred_root(depth, blur_px) * std::sqrt(2 / radius_px);
    }
    // Gram-Schmidt, with the triangular factor kept for the two columns of `step`.
    const auto scale = [](std::vector<double>& v, double s) {
      for (double& value : v) value *= s;
    };
    const auto subtract = [](std::vector<double>& v, const std::vector<double>& from, double s) {
      for (std::size_t i = 0; i < v.size(); ++i) v[i] -= s * from[i];
    };
    scale(c.basis[0], 1 / std::sqrt(double(n)));
    subtract(c.basis[1], c.basis[0], dot(c.basis[1], c.basis[0]));
    const double r11 = std::sqrt(dot(c.basis[1], c.basis[1]));
    scale(c.basis[1], 1 / r11);
    subtract(c.basis[2], c.basis[0], dot(c.basis[2], c.basis[0]));
    const double r12 = dot(c.basis[2], c.basis[1]);
    subtract(c.basis[2], c.basis[1], r12);
    const double r22 = std::sqrt(dot(c.basis[2], c.basis[2]));
    scale(c.basis[2], 1 / r22);
    c.step_row[0] = 0;
    c.step_row[1] = 1 / r11;
    c.step_row[2] = -r12 / (r11 * r22);
    candidates_.push_back(std::move(c));
  }
}

std::optional<RimModel::Edge> RimModel::fit(std::span<const double> samples) const {
  const double total = dot(samples, samples);
  std::vector<double> left(candidates_.size());
  std::size_t best = 0;
  for (std::size_t k = 0; k < candidates_.size(); ++k) {
    left[k] = total;
    for (const std::vector<double>& b : candidates_[k].basis) {
      const double coefficient = dot(samples, b);
      left[k] -= coefficient * coefficient;
    }
    if (left[k] < left[best]) best = k;
  }
  if (best == 0 || best + 1 == candidates_.size()) return std::nullopt;
  // The lowest point of the parabola through the best three.
  const double curvature = left[best - 1] - 2 * left[best] + left[best + 1];
  const double shift = curvature > 0 ? 0.5 * (left[best - 1] - left[best + 1]) / curvature : 0;
  const Candidate& c = candidates_[best];
  double step = 0;
  for (std::size_t k = 0; k < 3; ++k) step += c.step_row[k] * dot(samples, c.basis[k]);
  return Edge{c.offset_px + shift * kOffsetStepPx, step, std::sqrt(std::max(0.0, left[best]) / double(samples.size()))};
}

}  // namespace lightstage::calib
