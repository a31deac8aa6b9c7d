#include "model/alias_free_weights.h"

#include <algorithm>
#include <cmath>
#include <string>

#include "core/error.h"

namespace lightstage::model {
namespace {

// Half the squared chord, which is 1 - q.l without its cancellation near the query.
double half_squared_chord(const core::Direction& q, const core::Direction& l) {
  const core::Vec3 d = q.vec() - l.vec();
  return dot(d, d) / 2;
}

// Where the half squared chords of the active set spread over less than this, their differences are rounding errors of the
// coordinates (about 4e-16) and no longer order the lights.
constexpr double kEquidistant = 1e-12;

// The active set relative to its nearest and farthest light.
struct Distances {
  std::vector<double> beyond_nearest;   // b_i = a_i - a_near
  std::vector<double> before_farthest;  // c_i = a_far - a_i
  double spread = 0;                    // a_far - a_near
};

Distances distances(const core::Direction& query, std::span<const core::Direction> lights) {
  std::vector<double> a(lights.size());
  std::transform(lights.begin(), lights.end(), a.begin(), [&](const auto& l) { return half_squared_chord(query, l); });
  const auto [nearest, farthest] = std::minmax_element(a.begin(), a.end());
  Distances d;
  d.spread = *farthest - *nearest;
  for (const double value : a) {
    d.beyond_nearest.push_back(value - *nearest);
    d.before_farthest.push_back(*farthest - value);
  }
  return d;
}

// w_i / w_near = exp(-s b_i) (1 - exp(-s c_i)) / (1 - exp(-s spread)), and its limit c_i / spread for s -> 0.
double relative_weight(double s, double b, double c, double spread) {
  constexpr double kLinear = 1e-10;  // below it the next term of the series is lost in float64
  const double rise = s * spread < kLinear ? c / spread : std::expm1(-s * c) / std::expm1(-s * spread);
  return std::exp(-s * b) * rise;
}

// d ln w_i / d ln s = -s b_i + x / expm1(x) - 1 with x = s c_i, but for a term common to all lights, which normalising removes.
double log_slope(double s, double b, double c) {
  const double x = s * c;
  const double ratio = x < 1e-300 ? 1 : x / std::expm1(x);
  return ratio - 1 - s * b;
}

void check(std::span<const core::Direction> lights, double s) {
  if (lights.empty()) throw core::BadInput("alias-free weights: there are no lights to weigh");
  if (!std::isfinite(s) || s < 0) {
    throw core::BadInput("alias-free weights: sharpness " + std::to_string(s) + " is not a finite number >= 0");
  }
}

}  // namespace

std::vector<double> alias_free_weights(const core::Direction& query, std::span<const core::Direction> lights,
                                       double s) {
  return sloped_alias_free_weights(query, lights, s).weights;
}

SlopedWeights sloped_alias_free_weights(const core::Direction& query, std::span<const core::Direction> lights,
                                        double s) {
  check(lights, s);
  const Distances d = distances(query, lights);
  const std::size_t k = lights.size();
  SlopedWeights result{std::vector<double>(k, 1.0 / double(k)), std::vector<double>(k, 0.0)};
  if (d.spread == 0) return result;

  std::vector<double> w(k), slope(k);
  double sum = 0, slope_sum = 0;
  for (std::size_t i = 0; i < k; ++i) {
    w[i] = relative_weight(s, d.beyond_nearest[i], d.before_farthest[i], d.spread);
    // A weight that has underflowed stays 0 whatever s does.
    slope[i] = w[i] > 0 ? w[i] * log_slope(s, d.beyond_nearest[i], d.before_farthest[i]) : 0;
    sum += w[i];  // at least 1: the nearest light's
    slope_sum += slope[i];
  }
  // Fades to uniform weights over a range far below any real distance, so that the 0/0 of equidistant lights is no jump. From a
  // spread of 1e-4 on the share is below rounding, and taken as 0 so that the farthest light weighs nothing at all.
  const double relative_spread = d.spread / kEquidistant;
  const double share = 1 / (1 + relative_spread * relative_spread);
  const double uniform = share < 1e-16 ? 0 : share;
  for (std::size_t i = 0; i < k; ++i) {
    result.weights[i] = (1 - uniform) * w[i] / sum + uniform / double(k);
    result.slopes[i] = (1 - uniform) * (slope[i] - w[i] / sum * slope_sum) / sum;
  }
  return result;
}

double default_sharpness(double spacing_radians) {
  if (!std::isfinite(spacing_radians) || spacing_radians <= 0) {
    throw core::BadInput("default sharpness: light spacing " + std::to_string(spacing_radians) +
                         " is not a finite number of radians > 0");
  }
  return 2 / (spacing_radians * spacing_radians);
}

}  // namespace lightstage::model
