// Numbers and tables as text.
#pragma once

#include <string>
#include <vector>

namespace lightstage::cli {

// A number with so many digits after the point; "-" for NaN.
std::string fixed(double value, int digits);

// Columns padded to equal width, two spaces between; the first column left-aligned, the others right-aligned. Rows end with a newline.
std::string table(const std::vector<std::vector<std::string>>& rows);

}  // namespace lightstage::cli
