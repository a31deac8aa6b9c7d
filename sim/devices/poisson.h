// Poisson-distributed counts.
#pragma once

#include <cmath>
#include <cstdint>

#include "sim/scene/random.h"

namespace lightstage::sim {

// Up to this mean counts are drawn exactly, above it approximately.
constexpr double kExactPoissonMean = 30;

// The seed's counter-th count, of mean `mean` (finite, >= 0). Up to kExactPoissonMean exact, by inversion of
// the distribution function. Above it real-valued, by the Cornish-Fisher expansion to the skewness (Cornish and
// Fisher 1938): mean + sqrt(mean) z + (z^2 - 1) / 6 with z standard normal, whose mean is exact, whose variance is
// mean + 1/18, and whose third moment is right to first order.
inline double poisson(double mean, std::uint64_t seed, std::uint64_t counter) {
  if (mean > kExactPoissonMean) {
    const double z = normal(seed, counter);
    return mean + std::sqrt(mean) * z + (z * z - 1) / 6;
  }
  const double u = uniform(seed, counter);
  double probability = std::exp(-mean);
  double cumulative = probability;
  int count = 0;
  // More than 200 has a probability under 1e-90; rounding in `cumulative` must not send the loop there for ever.
  while (u > cumulative && count < 200) {
    ++count;
    probability *= mean / count;
    cumulative += probability;
  }
  return count;
}

}  // namespace lightstage::sim
