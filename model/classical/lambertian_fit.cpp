#include "model/classical/lambertian_fit.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <opencv2/core.hpp>

namespace lightstage::model {

namespace {

constexpr double kDark = 0.15;  // of a pixel's bright values: what is below says nothing of its normal
constexpr double kGrazing =
    0.1;  // cosine below which a light is left out: there surfaces are rough and sources extended
constexpr double kSmallest =
    1e-3;  // error, relative to bright values, below which the least sum of absolute errors is that of squares
constexpr int kFirstIterations = 15, kIterations = 30, kScaleIterations = 8;
constexpr double kConverged = 1e-6;  // relative change of g

// The value that a pixel's bright ones have, whatever a few highlights do; the brightest where there are few.
double bright_value(std::span<const float> values) {
  std::vector<float> sorted(values.begin(), values.end());
  const auto nth = sorted.begin() + std::ptrdiff_t(double(sorted.size() - 1) * 0.95);
  std::nth_element(sorted.begin(), nth, sorted.end());
  return *nth > 0 ? double(*nth) : double(*std::max_element(sorted.begin(), sorted.end()));
}

double median_of(std::vector<double>& values) {
  const auto middle = values.begin() + std::ptrdiff_t(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

// (1 - (r / c)^2)^2 inside +-c, c = 4.685 sigma: 95 % efficient on normal errors.
double tukey_weight(double residual, double sigma) {
  const double u = residual / (4.685 * sigma);
  const double inside = std::max(1 - u * u, 0.0);
  return inside * inside;
}

}  // namespace

// The normal equations A g = b.
struct LambertianFitter::System {
  double xx = 0, xy = 0, xz = 0, yy = 0, yz = 0, zz = 0;
  core::Vec3 b;

  double trace() const { return xx + yy + zz; }

  core::Vec3 times(core::Vec3 g) const {
    return {xx * g.x + xy * g.y + xz * g.z, xy * g.x + yy * g.y + yz * g.z, xz * g.x + yz * g.y + zz * g.z};
  }

  // (A + ridge)^-1 v by Cholesky's decomposition.
  core::Vec3 solve_with_ridge(double ridge, core::Vec3 v) const {
    const double l11 = std::sqrt(xx + ridge), l21 = xy / l11, l31 = xz / l11;
    const double l22 = std::sqrt(yy + ridge - l21 * l21), l32 = (yz - l31 * l21) / l22;
    const double l33 = std::sqrt(zz + ridge - l31 * l31 - l32 * l32);
    const double a = v.x / l11, b2 = (v.y - l21 * a) / l22, c = (v.z - l31 * a - l32 * b2) / l33;
    const double z = c / l33, y = (b2 - l32 * z) / l22;
    return {(a - l21 * y - l31 * z) / l11, y, z};
  }

  // Iterated Tikhonov: what a singular value s of A loses of its solution is (ridge / (s + ridge))^2.
  core::Vec3 solve() const {
    if (!(trace() > 0)) return {};
    const double ridge = 1e-4 * trace();
    const core::Vec3 g = solve_with_ridge(ridge, b);
    return g + solve_with_ridge(ridge, b - times(g));
  }

  double condition() const {
    const cv::Matx33d a(xx, xy, xz, xy, yy, yz, xz, yz, zz);
    cv::Vec3d values;
    cv::eigen(a, values);
    const double largest = std::max(values[0], 0.0), smallest = std::max(values[2], 0.0);
    if (!(largest > 0) || smallest <= largest / (kWorstCondition * kWorstCondition)) return kWorstCondition;
    return std::sqrt(largest / smallest);
  }
};

LambertianFitter::LambertianFitter(std::span<const core::Direction> lights) {
  for (const core::Direction& light : lights) {
    x_.push_back(light.x());
    y_.push_back(light.y());
    z_.push_back(light.z());
  }
}

LambertianFitter::System LambertianFitter::system(std::span<const double> values,
                                                  std::span<const double> weights) const {
  System s;
  for (std::size_t i = 0; i < values.size(); ++i) {
    const double wx = weights[i] * x_[i], wy = weights[i] * y_[i], wz = weights[i] * z_[i];
    s.xx += wx * x_[i];
    s.xy += wx * y_[i];
    s.xz += wx * z_[i];
    s.yy += wy * y_[i];
    s.yz += wy * z_[i];
    s.zz += wz * z_[i];
    s.b.x += wx * values[i];
    s.b.y += wy * values[i];
    s.b.z += wz * values[i];
  }
  return s;
}

LambertianFit LambertianFitter::operator()(std::span<const float> values, std::span<double> weights) const {
  const std::size_t n = light_count();
  std::fill(weights.begin(), weights.end(), 0.0);
  const double scale = bright_value(values);
  LambertianFit fit;
  fit.condition = kWorstCondition;
  if (!(scale > 0)) return fit;

  std::vector<double> v(n), cosine(n), errors;
  errors.reserve(n);
  for (std::size_t i = 0; i < n; ++i) v[i] = double(values[i]) / scale;
  const auto predict = [&](core::Vec3 g) {
    for (std::size_t i = 0; i < n; ++i) cosine[i] = g.x * x_[i] + g.y * y_[i] + g.z * z_[i];
  };
  const auto changed = [](core::Vec3 from, core::Vec3 to) { return norm(to - from) > kConverged * norm(to); };

  for (std::size_t i = 0; i < n; ++i) weights[i] = v[i] > kDark ? 1 : 0;
  System equations = system(v, weights);
  core::Vec3 g = equations.solve();
  for (int iteration = 0; iteration < kFirstIterations; ++iteration) {
    predict(g);
    for (std::size_t i = 0; i < n; ++i)
      if (v[i] > kDark) weights[i] = kSmallest / std::max(std::abs(v[i] - cosine[i]), kSmallest);
    const core::Vec3 next = system(v, weights).solve();
    const bool moves = norm(next - g) > 1e-3 * norm(next);
    g = next;
    if (!moves) break;
  }

  // Shadows would make the scale of errors that of shading.
  const auto error_scale = [&](double length) {
    errors.clear();
    for (std::size_t i = 0; i < n; ++i)
      if (cosine[i] > kGrazing * length && v[i] > 0.25 * cosine[i]) errors.push_back(std::abs(v[i] - cosine[i]));
    return errors.empty() ? 0 : std::max(1.4826 * median_of(errors), 1e-3 * length);
  };
  double sigma = std::numeric_limits<double>::infinity();
  std::vector<double> tried(n);
  for (int iteration = 0; iteration < kIterations; ++iteration) {
    predict(g);
    const double length = norm(g);
    if (iteration < kScaleIterations) sigma = std::min(sigma, error_scale(length));
    if (!(sigma > 0)) break;
    double facing = 0, agreeing = 0;
    for (std::size_t i = 0; i < n; ++i) {
      const double faces = cosine[i] > kGrazing * length ? 1 : 0;
      tried[i] = faces * tukey_weight(v[i] - cosine[i], sigma);
      facing += faces;
      agreeing += tried[i];
    }
    if (!(agreeing > 1e-3)) break;
    std::copy(tried.begin(), tried.end(), weights.begin());
    equations = system(v, weights);
    fit.share = agreeing / facing;
    const core::Vec3 next = equations.solve();
    const bool moves = changed(g, next);
    g = next;
    if (!moves) break;
  }
  fit.scaled_normal = g * scale;
  fit.condition = equations.condition();
  return fit;
}

}  // namespace lightstage::model
