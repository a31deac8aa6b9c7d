#include "model/classical/thin_plate.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <opencv2/core.hpp>
#include <string>

#include "core/error.h"
#include "model/classical/ordered_sum.h"

namespace lightstage::model {

namespace {

constexpr std::size_t kMaxLights = 8000;
constexpr double kFlat = 1e-2;  // spread relative to the widest axis

double squared_distance(core::Vec3 a, core::Vec3 b) {
  const core::Vec3 d = a - b;
  return core::dot(d, d);
}

// r^2 log r from r^2; its limit at 0 is 0.
double kernel(double r2) {
  return r2 > 0 ? 0.5 * r2 * std::log(r2) : 0.0;
}

}  // namespace

ThinPlateWeights::ThinPlateWeights(std::span<const core::Direction> lights) : lights_(lights) {
  if (lights.size() > kMaxLights)
    throw core::UsageError("rbf solves one dense system over all lights and takes at most " +
                           std::to_string(kMaxLights) + " of them, not " + std::to_string(lights.size()) +
                           "; use linear, or fewer lights");
  choose_polynomial();
  invert();
}

void ThinPlateWeights::choose_polynomial() {
  const int n = static_cast<int>(lights_.points().size());
  centre_ = std::accumulate(lights_.points().begin(), lights_.points().end(), core::Vec3{}) / double(n);
  cv::Mat spread(n, 3, CV_64F);
  for (int i = 0; i < n; ++i) {
    const core::Vec3 d = lights_.points()[std::size_t(i)] - centre_;
    spread.at<double>(i, 0) = d.x;
    spread.at<double>(i, 1) = d.y;
    spread.at<double>(i, 2) = d.z;
  }
  const cv::SVD principal(spread);
  const double widest = principal.w.at<double>(0);
  for (int k = 0; k < principal.w.rows; ++k) {
    if (!(principal.w.at<double>(k) > kFlat * widest)) break;
    const double* axis = principal.vt.ptr<double>(k);
    axes_.push_back({axis[0], axis[1], axis[2]});
  }
}

std::vector<double> ThinPlateWeights::right_side(core::Vec3 query) const {
  std::vector<double> b;
  b.reserve(lights_.points().size() + 1 + axes_.size());
  for (const core::Vec3 point : lights_.points()) b.push_back(kernel(squared_distance(query, point)));
  b.push_back(1);
  for (const core::Vec3 axis : axes_) b.push_back(core::dot(axis, query - centre_));
  return b;
}

void ThinPlateWeights::invert() {
  const int n = static_cast<int>(lights_.points().size());
  const int size = n + 1 + static_cast<int>(axes_.size());
  cv::Mat system = cv::Mat::zeros(size, size, CV_64F);
  for (int i = 0; i < n; ++i) {
    const std::vector<double> row = right_side(lights_.points()[std::size_t(i)]);
    for (int j = 0; j < size; ++j) system.at<double>(i, j) = row[std::size_t(j)];
    for (int j = n; j < size; ++j) system.at<double>(j, i) = row[std::size_t(j)];
  }
  cv::Mat inverse;
  // The pseudo-inverse serves where elimination meets a pivot lost in rounding.
  if (cv::invert(system, inverse, cv::DECOMP_LU) == 0) cv::invert(system, inverse, cv::DECOMP_SVD);
  inverse_.reserve(std::size_t(n) * std::size_t(size));
  // M is symmetric, and so is its inverse: a row, cut to the points, is a column of the part that gives w.
  for (int j = 0; j < size; ++j) inverse_.insert(inverse_.end(), inverse.ptr<double>(j), inverse.ptr<double>(j) + n);
}

template <class Value>
std::vector<Value> ThinPlateWeights::solve(const std::vector<Value>& b) const {
  // Column by column, which the compiler can put into vector registers, as a sum along rows it may not.
  std::vector<Value> at_points(lights_.points().size());
  const double* column = inverse_.data();
  for (std::size_t j = 0; j < b.size(); ++j, column += lights_.points().size())
    for (std::size_t i = 0; i < lights_.points().size(); ++i) at_points[i] = at_points[i] + column[i] * b[j];
  return at_points;
}

std::vector<double> ThinPlateWeights::operator()(const core::Direction& query) const {
  const std::vector<double> on_a_light = lights_.one_hot_at(query.vec());
  return lights_.per_light(on_a_light.empty() ? solve(right_side(query.vec())) : on_a_light);
}

std::vector<core::Vec3> ThinPlateWeights::sum(std::span<const DistantLight> lights) const {
  const std::size_t terms = lights_.points().size() + 1 + axes_.size();
  return lights_.per_light(solve(ordered_sum(lights.size(), terms, [&](std::size_t q, std::vector<core::Vec3>& total) {
    const std::vector<double> b = right_side(lights[q].direction.vec());
    for (std::size_t j = 0; j < terms; ++j) total[j] = total[j] + b[j] * lights[q].irradiance;
  })));
}

}  // namespace lightstage::model
