#include "db/import/text_table.h"

#include <algorithm>
#include <cmath>

#include "core/error.h"
#include "core/file.h"
#include "core/text.h"

namespace lightstage::db {

std::vector<TextLine> read_lines(const std::filesystem::path& path) {
  const std::string text = core::read_text_file(path);
  std::string_view rest = text;
  if (rest.starts_with("\xEF\xBB\xBF")) rest.remove_prefix(3);  // byte order mark
  std::vector<TextLine> lines;
  std::size_t number = 0;
  for (const std::string_view raw : core::split(rest, '\n')) {
    ++number;
    const std::string_view line = core::trim(raw);
    if (!line.empty()) lines.push_back({std::string(line), path.string() + ":" + std::to_string(number)});
  }
  return lines;
}

double finite_number(std::string_view text, const std::string& place) {
  const auto value = core::parse_number(core::trim(text));
  if (!value || !std::isfinite(*value)) {
    throw core::BadInput(place + ": '" + std::string(text) + "' is not a finite number");
  }
  return *value;
}

std::array<double, 3> three_numbers(const TextLine& line) {
  std::string text = line.text;
  std::replace(text.begin(), text.end(), '\t', ' ');
  std::array<double, 3> values{};
  std::size_t count = 0;
  for (const std::string_view word : core::split(text, ' ')) {
    if (word.empty()) continue;
    if (count < values.size()) values[count] = finite_number(word, line.place);
    ++count;
  }
  if (count != values.size()) {
    throw core::BadInput(line.place + ": expected 3 numbers, found " + std::to_string(count));
  }
  return values;
}

core::Direction direction_at(core::Vec3 vector, const std::string& place) {
  try {
    return core::Direction::from_vector(vector);
  } catch (const core::BadInput& error) {
    throw core::BadInput(place + ": " + error.what());
  }
}

void require_positive(const std::array<double, 3>& intensity, const std::string& place) {
  for (const double value : intensity) {
    if (!(value > 0)) throw core::BadInput(place + ": a light's intensity must be greater than 0");
  }
}

}  // namespace lightstage::db
