#include "core/light_list.h"

#include <string_view>

#include "core/error.h"
#include "core/file.h"
#include "core/text.h"

namespace lightstage::core {

namespace {

// Cuts the last blank-separated word off `line`.
std::string_view take_last_word(std::string_view& line) {
  const std::string_view rest = trim(line);
  const std::size_t blank = rest.find_last_of(" \t");
  const std::size_t start = blank == std::string_view::npos ? 0 : blank + 1;
  line = trim(rest.substr(0, start));
  return rest.substr(start);
}

LpEntry parse_entry(std::string_view line) {
  std::array<std::string_view, 3> words;
  for (std::size_t axis = 3; axis-- > 0;) words[axis] = take_last_word(line);
  if (line.empty()) throw BadInput("expected 'name x y z'");
  std::array<double, 3> xyz{};
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const std::optional<double> value = parse_number(words[axis]);
    if (!value) throw BadInput("'" + std::string(words[axis]) + "' is not a number; expected 'name x y z'");
    xyz[axis] = *value;
  }
  return {std::string(line), Direction::from_vector({xyz[0], xyz[1], xyz[2]})};
}

}  // namespace

std::vector<LpEntry> read_lp(const std::filesystem::path& path) {
  const std::string text = read_text_file(path);
  std::string_view rest = text;
  if (rest.starts_with("\xEF\xBB\xBF")) rest.remove_prefix(3);  // byte order mark
  const auto fail = [&](std::size_t line_number, const std::string& problem) {
    return BadInput(path.string() + ":" + std::to_string(line_number) + ": " + problem);
  };

  std::optional<std::int64_t> count;
  std::size_t count_line = 1;
  std::vector<LpEntry> entries;
  std::size_t line_number = 0;
  for (const std::string_view raw_line : split(rest, '\n')) {
    ++line_number;
    const std::string_view line = trim(raw_line);
    if (line.empty()) continue;
    if (!count) {
      count = parse_integer(line);
      count_line = line_number;
      if (!count || *count < 1)
        throw fail(line_number, "expected the number of lights, not '" + std::string(line) + "'");
      continue;
    }
    try {
      entries.push_back(parse_entry(line));
    } catch (const BadInput& problem) {
      throw fail(line_number, problem.what());
    }
  }
  if (!count) throw fail(1, "the file is empty; expected the number of lights");
  if (entries.size() != static_cast<std::uint64_t>(*count))
    throw fail(count_line,
               "says " + std::to_string(*count) + " lights, but " + std::to_string(entries.size()) + " follow");
  return entries;
}

void write_lp(const std::filesystem::path& path, const std::vector<LpEntry>& entries) {
  if (entries.empty()) throw BadInput("cannot write " + path.string() + ": there are no lights");
  std::string text = std::to_string(entries.size()) + "\n";
  for (const LpEntry& entry : entries) {
    if (entry.name.empty() || trim(entry.name) != entry.name || entry.name.find_first_of("\r\n") != std::string::npos)
      throw BadInput("cannot write " + path.string() + ": a light's name '" + entry.name +
                     "' is empty, holds a line break, or begins or ends with a blank");
    text += entry.name;
    for (const double v : {entry.direction.x(), entry.direction.y(), entry.direction.z()})
      text.append(" ").append(number_text(v));
    text += "\n";
  }
  write_file_atomically(path, text);
}

}  // namespace lightstage::core
