// Order statistics for robust estimates.
#pragma once

#include <vector>

namespace lightstage::calib {

// The value at the share `q` (0 to 1) of the sorted values, by nearest rank; 0 for none. Reorders `values`.
// O(n).
double quantile(std::vector<double>& values, double q);

// Scale of normally distributed residuals about 0 from their median magnitude: outliers below half do not
// matter.
double robust_sigma(const std::vector<double>& residuals);

}  // namespace lightstage::calib
