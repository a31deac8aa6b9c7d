// Sums of weights, and with them.
#pragma once

#include <cstddef>
#include <vector>

namespace lightstage::test {

inline double sum_of(const std::vector<double>& values) {
  long double sum = 0;
  for (const double v : values) sum += v;
  return double(sum);
}

inline double weighted_sum(const std::vector<double>& weights, const std::vector<double>& values) {
  double sum = 0;
  for (std::size_t i = 0; i < values.size(); ++i) sum += weights[i] * values[i];
  return sum;
}

}  // namespace lightstage::test
