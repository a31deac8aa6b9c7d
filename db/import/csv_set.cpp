// A CSV with a header line that names its columns.
#include <algorithm>
#include <map>
#include <optional>

#include "core/error.h"
#include "core/text.h"
#include "db/import/listed_file.h"
#include "db/import/picture_set.h"
#include "db/import/text_table.h"
#include "db/importers.h"

namespace lightstage::db {

namespace fs = std::filesystem;

namespace {

// Fields of one line; a field in double quotes may hold commas, and "" for a quote (RFC 4180, without line
// breaks in fields).
std::vector<std::string> csv_fields(const TextLine& line) {
  std::vector<std::string> fields(1);
  bool quoted = false;
  for (std::size_t i = 0; i < line.text.size(); ++i) {
    const char c = line.text[i];
    if (c == '"' && quoted && i + 1 < line.text.size() && line.text[i + 1] == '"') {
      fields.back() += line.text[++i];
    } else if (c == '"') {
      quoted = !quoted;
    } else if (c == ',' && !quoted) {
      fields.emplace_back();
    } else {
      fields.back() += c;
    }
  }
  if (quoted) throw core::BadInput(line.place + ": a quote is not closed");
  for (std::string& field : fields) field = std::string(core::trim(field));
  return fields;
}

class CsvHeader {
 public:
  explicit CsvHeader(const TextLine& line) : place_(line.place) {
    const std::vector<std::string> known{"file", "x", "y", "z", "longitude", "latitude", "r", "g", "b", "intensity"};
    const std::vector<std::string> names = csv_fields(line);
    for (std::size_t i = 0; i < names.size(); ++i) {
      if (std::find(known.begin(), known.end(), names[i]) == known.end()) {
        throw core::BadInput(place_ + ": column '" + names[i] +
                             "' is not known; columns are file, x,y,z or longitude,latitude, and r,g,b or intensity");
      }
      if (!columns_.emplace(names[i], i).second)
        throw core::BadInput(place_ + ": column '" + names[i] + "' comes twice");
    }
    if (!columns_.contains("file")) throw core::BadInput(place_ + ": there is no column 'file'");
    if (has({"x", "y", "z"}) == has({"longitude", "latitude"})) {
      throw core::BadInput(place_ + ": the directions need either columns x,y,z or longitude,latitude");
    }
    if (has({"r", "g", "b"}) && has({"intensity"})) {
      throw core::BadInput(place_ + ": the strengths are given twice, as r,g,b and as intensity");
    }
  }

  std::size_t size() const { return columns_.size(); }
  std::size_t at(const std::string& name) const { return columns_.at(name); }

  // All of the columns (true) or none (false); anything between is refused.
  bool has(const std::vector<std::string>& names) const {
    const auto count =
        std::count_if(names.begin(), names.end(), [&](const auto& name) { return columns_.contains(name); });
    if (count != 0 && count != std::ptrdiff_t(names.size())) {
      throw core::BadInput(place_ + ": of the columns " + names.front() + " to " + names.back() +
                           " only some are there");
    }
    return count != 0;
  }

 private:
  std::string place_;
  std::map<std::string, std::size_t> columns_;
};

PictureEntry parse_row(const CsvHeader& header, const TextLine& line, const fs::path& folder) {
  const std::vector<std::string> fields = csv_fields(line);
  if (fields.size() != header.size()) {
    throw core::BadInput(line.place + ": " + std::to_string(fields.size()) + " fields, but the header names " +
                         std::to_string(header.size()));
  }
  const auto number = [&](const std::string& column) { return finite_number(fields[header.at(column)], line.place); };
  PictureEntry entry;
  if (header.has({"x", "y", "z"})) {
    entry.direction = direction_at({number("x"), number("y"), number("z")}, line.place);
  } else {
    const double latitude = number("latitude");
    if (std::abs(latitude) > 90) throw core::BadInput(line.place + ": the latitude is beyond 90 degrees");
    entry.direction = core::Direction::from_longitude_latitude_degrees(number("longitude"), latitude);
  }
  if (header.has({"r", "g", "b"})) entry.intensity = {number("r"), number("g"), number("b")};
  if (header.has({"intensity"})) entry.intensity.fill(number("intensity"));
  require_positive(entry.intensity, line.place);
  entry.path = find_listed_file(folder, fields[header.at("file")], line.place);
  return entry;
}

}  // namespace

PictureSet read_csv_set(const fs::path& path) {
  std::error_code none;
  const fs::path file = fs::is_directory(path, none) ? path / "lights.csv" : path;
  const std::vector<TextLine> lines = read_lines(file);
  if (lines.size() < 2) throw core::BadInput(file.string() + ": expected a header line and a line a light");
  const CsvHeader header(lines.front());
  const fs::path folder = folder_of(file);
  PictureSet set;
  set.format = "csv";
  set.source = file;
  for (std::size_t i = 1; i < lines.size(); ++i) set.pictures.push_back(parse_row(header, lines[i], folder));
  require_distinct(set);
  set.mask = mask_beside(folder);
  return set;
}

}  // namespace lightstage::db
