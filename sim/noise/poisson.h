// Poisson-distributed counts from given uniform and normal numbers.
#pragma once

#include <cmath>

namespace lightstage::sim {

// Below this mean counts are drawn exactly, above it approximately.
constexpr double kExactPoissonMean = 30;

// A count of mean `mean` >= 0 (not infinite) from u uniform in (0, 1) or z standard normal. Up to
// kExactPoissonMean exact, by inversion of the distribution function; above, real-valued, by the
// Cornish-Fisher expansion to the skewness (1938), mean + sqrt(mean) z + (z^2 - 1)/6: mean and third moment
// are exact to first order, the variance is mean + 1/18.
inline double poisson(double mean, double u, double z) {
  if (mean > kExactPoissonMean) return mean + std::sqrt(mean) * z + (z * z - 1) / 6;
  double probability = std::exp(-mean);
  double cumulative = probability;
  int count = 0;
  // The tail beyond 200 has a probability under 1e-90; rounding of `cumulative` must not send the loop there
  // for ever.
  while (u > cumulative && count < 200) {
    ++count;
    probability *= mean / count;
    cumulative += probability;
  }
  return count;
}

}  // namespace lightstage::sim
