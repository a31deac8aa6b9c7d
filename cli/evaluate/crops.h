// The places where methods differ most, side by side.
#pragma once

#include <vector>

#include "cli/evaluate/report.h"
#include "core/image.h"

namespace lightstage::cli {

struct CropSheet {
  core::Image
      sheet;  // display values: the whole truth with the crop marked, the truth's crop, every method's, and their errors
  std::string caption;  // which light, and how the methods score there
};

// One sheet for each of the `count` queries at which the methods' mean squared errors are farthest apart, of the square (a third of the picture's shorter
// side, 32 pixels at least) over which the squared errors of the best and the worst method at each masked pixel are farthest apart. Renders each again.
std::vector<CropSheet> crops_where_methods_differ(const JudgedStage& stage, bool linear_values, std::size_t count);

}  // namespace lightstage::cli
