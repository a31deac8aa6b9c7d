#include "model/classical/bspline_weights.h"

#include <algorithm>
#include <cmath>
#include <opencv2/core.hpp>
#include <utility>

#include "core/parallel.h"

namespace lightstage::model {

namespace {

// The four uniform cubic B-splines that are not 0 in a cell, at t in [0, 1] of it.
std::array<double, 4> cubic(double t) {
  const double s = 1 - t;
  return {s * s * s / 6, ((3 * t - 6) * t * t + 4) / 6, ((3 * s - 6) * s * s + 4) / 6, t * t * t / 6};
}

int cell_of(double coordinate, int cells) {
  return std::clamp(int((coordinate + 1) / 2 * cells), 0, cells - 1);
}

}  // namespace

BSplineWeights::BSplineWeights(std::span<const core::Direction> lights)
    : lights_(lights), polynomial_(lights_.points()) {
  const auto& points = lights_.points();
  const int n = int(points.size()), terms = int(polynomial_.count());
  cv::Mat p(n, terms, CV_64F), fit;
  for (int i = 0; i < n; ++i) {
    polynomial_at_points_.push_back(polynomial_.at(points[std::size_t(i)]));
    std::copy(polynomial_at_points_.back().begin(), polynomial_at_points_.back().end(), p.ptr<double>(i));
  }
  cv::invert(p, fit, cv::DECOMP_SVD);
  for (int term = 0; term < terms; ++term)
    polynomial_fit_.emplace_back(fit.ptr<double>(term), fit.ptr<double>(term) + n);

  // Two lights share no spline where their cells are four apart along an axis.
  const auto share = [&](int cells) {
    for (std::size_t a = 0; a < points.size(); ++a) {
      for (std::size_t b = 0; b < a; ++b) {
        const auto near = [&](double u, double v) { return std::abs(cell_of(u, cells) - cell_of(v, cells)) < 4; };
        if (near(points[a].x, points[b].x) && near(points[a].y, points[b].y) && near(points[a].z, points[b].z))
          return true;
      }
    }
    return false;
  };
  for (int cells = 1;; cells *= 2) {
    levels_.push_back(level(cells));
    if (!share(cells)) break;
  }
}

void BSplineWeights::splines_at(core::Vec3 place, int cells, Keys& keys, Splines& values) {
  const std::array<double, 3> coordinates{place.x, place.y, place.z};
  std::array<std::array<double, 4>, 3> along;
  std::array<std::uint64_t, 3> first{};
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const int cell = cell_of(coordinates[axis], cells);
    first[axis] = std::uint64_t(cell);
    along[axis] = cubic((coordinates[axis] + 1) / 2 * cells - cell);
  }
  std::size_t s = 0;
  for (std::uint64_t i = 0; i < 4; ++i)
    for (std::uint64_t j = 0; j < 4; ++j)
      for (std::uint64_t k = 0; k < 4; ++k, ++s) {
        keys[s] = ((first[0] + i) << 42) | ((first[1] + j) << 21) | (first[2] + k);
        values[s] = along[0][i] * along[1][j] * along[2][k];
      }
}

BSplineWeights::Level BSplineWeights::level(int cells) const {
  Level made;
  made.cells = cells;
  std::vector<double> squares;  // sum_c B_ck^2
  for (const core::Vec3 point : lights_.points()) {
    Keys keys;
    Splines values;
    splines_at(point, cells, keys, values);
    std::array<std::uint32_t, kSplines> indices;
    for (std::size_t s = 0; s < kSplines; ++s) {
      indices[s] = made.index.try_emplace(keys[s], std::uint32_t(made.index.size())).first->second;
      squares.resize(made.index.size());
      squares[indices[s]] += values[s] * values[s];
    }
    made.splines_of_point.push_back(indices);
    made.values.push_back(values);
  }
  for (std::size_t point = 0; point < made.values.size(); ++point) {
    const Splines& values = made.values[point];
    double own_squares = 0;
    for (const double b : values) own_squares += b * b;
    Splines coefficients;
    for (std::size_t s = 0; s < kSplines; ++s) {
      const double of_all = squares[made.splines_of_point[point][s]];
      // A spline that all lights are at the very edge of has squares that underflow, and no say.
      coefficients[s] = of_all > 0 ? values[s] * (values[s] * values[s] / of_all) / own_squares : 0.0;
    }
    made.coefficient_per.push_back(coefficients);
  }
  return made;
}

// v + C^T (e - E^T v) a level, from fine to coarse.
template <class Value>
std::vector<Value> BSplineWeights::weights(const std::vector<Value>& polynomial, Summed<Value> splines) const {
  const std::size_t n = lights_.points().size();
  std::vector<Value> v(n);
  for (std::size_t l = levels_.size(); l-- > 0;) {
    const Level& level = levels_[l];
    std::vector<Value>& e = splines[l];
    for (std::size_t point = 0; point < n; ++point)
      for (std::size_t s = 0; s < kSplines; ++s) {
        Value& of_spline = e[level.splines_of_point[point][s]];
        of_spline = of_spline - v[point] * level.values[point][s];
      }
    for (std::size_t point = 0; point < n; ++point)
      for (std::size_t s = 0; s < kSplines; ++s)
        v[point] = v[point] + e[level.splines_of_point[point][s]] * level.coefficient_per[point][s];
  }
  std::vector<Value> rest = polynomial;
  for (std::size_t point = 0; point < n; ++point)
    for (std::size_t term = 0; term < rest.size(); ++term)
      rest[term] = rest[term] - v[point] * polynomial_at_points_[point][term];
  for (std::size_t point = 0; point < n; ++point)
    for (std::size_t term = 0; term < rest.size(); ++term)
      v[point] = v[point] + rest[term] * polynomial_fit_[term][point];
  return lights_.per_light(v);
}

std::vector<double> BSplineWeights::operator()(const core::Direction& query) const {
  const std::vector<double> on_a_light = lights_.one_hot_at(query.vec());
  if (!on_a_light.empty()) return lights_.per_light(on_a_light);
  Summed<double> splines;
  for (const Level& level : levels_) {
    Keys keys;
    Splines values;
    splines_at(query.vec(), level.cells, keys, values);
    std::vector<double>& e = splines.emplace_back(level.index.size());
    for (std::size_t s = 0; s < kSplines; ++s)
      if (const auto found = level.index.find(keys[s]); found != level.index.end()) e[found->second] = values[s];
  }
  return weights(polynomial_.at(query.vec()), std::move(splines));
}

std::vector<core::Vec3> BSplineWeights::sum(std::span<const DistantLight> lights) const {
  // Each level by one thread, in the order of the lights: the same for every thread count.
  Summed<core::Vec3> splines(levels_.size());
  core::parallel_for(levels_.size(), 1, [&](std::size_t first, std::size_t last) {
    for (std::size_t l = first; l < last; ++l) {
      splines[l].resize(levels_[l].index.size());
      for (const DistantLight& light : lights) {
        Keys keys;
        Splines values;
        splines_at(light.direction.vec(), levels_[l].cells, keys, values);
        for (std::size_t s = 0; s < kSplines; ++s) {
          const auto found = levels_[l].index.find(keys[s]);
          if (found == levels_[l].index.end()) continue;
          core::Vec3& of_spline = splines[l][found->second];
          of_spline = of_spline + values[s] * light.irradiance;
        }
      }
    }
  });
  std::vector<core::Vec3> polynomial(polynomial_.count());
  for (const DistantLight& light : lights) {
    const std::vector<double> terms = polynomial_.at(light.direction.vec());
    for (std::size_t term = 0; term < terms.size(); ++term)
      polynomial[term] = polynomial[term] + terms[term] * light.irradiance;
  }
  return weights(polynomial, std::move(splines));
}

}  // namespace lightstage::model
