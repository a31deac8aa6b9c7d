#include "model/classical/radial_basis.h"

#include <algorithm>
#include <cmath>
#include <opencv2/core.hpp>
#include <string>

#include "core/error.h"
#include "core/text.h"
#include "model/classical/ordered_sum.h"

namespace lightstage::model {

namespace {

constexpr std::size_t kMaxLights = 8000;

double squared_distance(core::Vec3 a, core::Vec3 b) {
  const core::Vec3 d = a - b;
  return core::dot(d, d);
}

// The trace of a kernel matrix with a zero diagonal on the vectors perpendicular to the columns of `polynomial`.
double trace_beside(const cv::Mat& kernel, const cv::Mat& polynomial) {
  const cv::SVD columns(polynomial);
  return -cv::trace(columns.u.t() * kernel * columns.u)[0];
}

}  // namespace

RadialBasisWeights::RadialBasisWeights(std::span<const core::Direction> lights, const RadialBasis& basis)
    : basis_(basis), lights_(lights), polynomial_(lights_.points()) {
  if (lights.size() > kMaxLights)
    throw core::UsageError("rbf solves one dense system over all lights and takes at most " +
                           std::to_string(kMaxLights) + " of them, not " + std::to_string(lights.size()) +
                           "; use linear, or fewer lights");
  if (!(basis.smoothing >= 0 && std::isfinite(basis.smoothing)))
    throw core::UsageError("the smoothing of rbf is a number from 0, not " + core::number_text(basis.smoothing));
  invert();
}

// From r^2; the limit at 0 is 0.
double RadialBasisWeights::kernel(double r2) const {
  if (basis_.kernel == RadialKernel::kLinear) return -std::sqrt(r2);
  return r2 > 0 ? 0.5 * r2 * std::log(r2) : 0.0;
}

std::vector<double> RadialBasisWeights::right_side(core::Vec3 query) const {
  std::vector<double> b;
  b.reserve(lights_.points().size() + polynomial_.count());
  for (const core::Vec3 point : lights_.points()) b.push_back(kernel(squared_distance(query, point)));
  for (const double term : polynomial_.at(query)) b.push_back(term);
  return b;
}

void RadialBasisWeights::invert() {
  const int n = static_cast<int>(lights_.points().size());
  const int size = n + static_cast<int>(polynomial_.count());
  cv::Mat system = cv::Mat::zeros(size, size, CV_64F);
  for (int i = 0; i < n; ++i) {
    const std::vector<double> row = right_side(lights_.points()[std::size_t(i)]);
    for (int j = 0; j < size; ++j) system.at<double>(i, j) = row[std::size_t(j)];
    for (int j = n; j < size; ++j) system.at<double>(j, i) = row[std::size_t(j)];
  }
  if (basis_.smoothing > 0) {
    const cv::Range points(0, n);
    const double ridge =
        basis_.smoothing * std::max(0.0, trace_beside(system(points, points), system(points, cv::Range(n, size))));
    for (int i = 0; i < n; ++i) system.at<double>(i, i) += ridge / double(lights_.lights_at(std::size_t(i)));
  }
  cv::Mat inverse;
  // The pseudo-inverse serves where elimination meets a pivot lost in rounding.
  if (cv::invert(system, inverse, cv::DECOMP_LU) == 0) cv::invert(system, inverse, cv::DECOMP_SVD);
  inverse_.reserve(std::size_t(n) * std::size_t(size));
  // M is symmetric, and so is its inverse: a row, cut to the points, is a column of the part that gives w.
  for (int j = 0; j < size; ++j) inverse_.insert(inverse_.end(), inverse.ptr<double>(j), inverse.ptr<double>(j) + n);
}

template <class Value>
std::vector<Value> RadialBasisWeights::solve(const std::vector<Value>& b) const {
  // Column by column, which the compiler can put into vector registers, as a sum along rows it may not.
  std::vector<Value> at_points(lights_.points().size());
  const double* column = inverse_.data();
  for (std::size_t j = 0; j < b.size(); ++j, column += lights_.points().size())
    for (std::size_t i = 0; i < lights_.points().size(); ++i) at_points[i] = at_points[i] + column[i] * b[j];
  return at_points;
}

std::vector<double> RadialBasisWeights::operator()(const core::Direction& query) const {
  const std::vector<double> on_a_light =
      basis_.smoothing == 0 ? lights_.one_hot_at(query.vec()) : std::vector<double>();
  return lights_.per_light(on_a_light.empty() ? solve(right_side(query.vec())) : on_a_light);
}

std::vector<core::Vec3> RadialBasisWeights::sum(std::span<const DistantLight> lights) const {
  const std::size_t terms = lights_.points().size() + polynomial_.count();
  return lights_.per_light(solve(ordered_sum(lights.size(), terms, [&](std::size_t q, std::vector<core::Vec3>& total) {
    const std::vector<double> b = right_side(lights[q].direction.vec());
    for (std::size_t j = 0; j < terms; ++j) total[j] = total[j] + b[j] * lights[q].irradiance;
  })));
}

}  // namespace lightstage::model
