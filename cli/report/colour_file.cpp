#include "cli/report/colour_file.h"

#include <algorithm>

#include "core/config.h"
#include "core/file.h"
#include "core/text.h"

namespace lightstage::cli {

namespace {

std::string row_text(const std::array<double, 3>& row) {
  constexpr int kDigits = 12;
  const auto number = [](double v) {
    std::string text = core::number_text(v, kDigits);
    // TOML tells floats from integers.
    return text.find_first_of(".e") == std::string::npos ? text + ".0" : text;
  };
  return "[" + number(row[0]) + ", " + number(row[1]) + ", " + number(row[2]) + "]";
}

}  // namespace

void write_colour(const std::filesystem::path& path, const calib::ColourFit& fit, const std::string& source) {
  std::string comment = source;
  std::replace_if(
      comment.begin(), comment.end(), [](unsigned char c) { return c < 32 || c > 126; }, '?');
  std::string text = "# Linear Rec. 709 = matrix x (white_balance * camera). From " + comment + ".\n";
  text += "# CIEDE2000 of the chart's patches: mean " + core::number_text(fit.mean_delta_e, 3) + ", largest " +
          core::number_text(fit.largest_delta_e, 3) + ".\n";
  text += "white_balance = " + row_text(fit.white_balance) + "\n";
  for (std::size_t r = 0; r < 3; ++r) {
    text += std::string(std::array{"red", "green", "blue"}[r]) + " = " + row_text(fit.matrix[r]) + "\n";
  }
  core::write_file_atomically(path, text);
}

calib::ColourFit read_colour(const std::filesystem::path& path) {
  const core::TomlTable table = core::TomlTable::read_file(path);
  calib::ColourFit fit;
  const auto read = [&](const char* key, std::array<double, 3>& row) {
    const std::vector<double> numbers = table.numbers(key, 3);
    std::copy(numbers.begin(), numbers.end(), row.begin());
  };
  read("white_balance", fit.white_balance);
  for (const double v : fit.white_balance) {
    if (!(v > 0)) table.fail("white_balance", "must hold three numbers above 0");
  }
  for (std::size_t r = 0; r < 3; ++r) read(std::array{"red", "green", "blue"}[r], fit.matrix[r]);
  table.finish();
  return fit;
}

std::array<std::array<double, 3>, 3> whole_matrix(const calib::ColourFit& fit, bool balanced) {
  auto matrix = fit.matrix;
  for (auto& row : matrix) {
    for (std::size_t c = 0; c < 3 && !balanced; ++c) row[c] *= fit.white_balance[c];
  }
  return matrix;
}

}  // namespace lightstage::cli
