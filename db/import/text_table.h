// Text files of one record a line, with the place of everything that is read.
#pragma once

#include <array>
#include <filesystem>
#include <string>
#include <vector>

#include "core/direction.h"

namespace lightstage::db {

struct TextLine {
  std::string text;   // trimmed
  std::string place;  // "FILE:LINE"
};

// The lines that are not blank. Throws BadInput when the file is missing.
std::vector<TextLine> read_lines(const std::filesystem::path& path);

// A finite number; BadInput at the line's place otherwise.
double finite_number(std::string_view text, const std::string& place);
// Exactly three finite numbers with blanks between.
std::array<double, 3> three_numbers(const TextLine& line);
// The direction of a vector; BadInput at the place when it has length zero.
core::Direction direction_at(core::Vec3 vector, const std::string& place);
// BadInput unless all three are greater than zero: pictures are divided by them.
void require_positive(const std::array<double, 3>& intensity, const std::string& place);

}  // namespace lightstage::db
