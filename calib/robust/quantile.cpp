#include "calib/robust/quantile.h"

#include <algorithm>
#include <cmath>

namespace lightstage::calib {

double quantile(std::vector<double>& values, double q) {
  if (values.empty()) return 0;
  const auto rank = static_cast<std::ptrdiff_t>(std::llround(q * double(values.size() - 1)));
  std::nth_element(values.begin(), values.begin() + rank, values.end());
  return values[std::size_t(rank)];
}

double robust_sigma(const std::vector<double>& residuals) {
  std::vector<double> magnitudes(residuals.size());
  std::transform(residuals.begin(), residuals.end(), magnitudes.begin(), [](double r) { return std::abs(r); });
  return 1.4826 * quantile(magnitudes, 0.5);  // 1 / the normal distribution's third quartile
}

}  // namespace lightstage::calib
