// A picture of pictures: truth beside what each method made of it, and the differences.
#pragma once

#include <string>
#include <vector>

#include "core/image.h"

namespace lightstage::cli {

struct SheetCell {
  core::Image picture;  // display values in [0, 1], 3 channels
  std::string caption;
};

// Rows of cells of one size, each with its caption below; returns display values. Cells larger than `largest` pixels are shrunk.
core::Image contact_sheet(const std::vector<std::vector<SheetCell>>& rows, int largest = 256);

// |a - b| times `gain`, averaged over channels, on a scale from black over red and yellow to white.
core::Image difference_picture(core::ImageView a, core::ImageView b, double gain);

}  // namespace lightstage::cli
