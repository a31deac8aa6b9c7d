// A camera's colours as a TOML file.
#pragma once

#include <filesystem>
#include <string>

#include "calib/colour_chart.h"

namespace lightstage::cli {

// `source`: where the chart was seen, for people who read the file.
void write_colour(const std::filesystem::path& path, const calib::ColourFit& fit, const std::string& source);
// White balance and matrix. Throws BadInput with file and line.
calib::ColourFit read_colour(const std::filesystem::path& path);

// One matrix that does both: matrix x white balance, or the matrix alone for pictures whose white is balanced already.
std::array<std::array<double, 3>, 3> whole_matrix(const calib::ColourFit& fit, bool balanced);

}  // namespace lightstage::cli
