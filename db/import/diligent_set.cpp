// The layout of the DiLiGenT benchmark (Shi et al. 2016, "A benchmark dataset and evaluation for
// non-Lambertian and uncalibrated photometric stereo").
#include "core/error.h"
#include "db/import/listed_file.h"
#include "db/import/picture_set.h"
#include "db/import/text_table.h"
#include "db/importers.h"

namespace lightstage::db {

namespace fs = std::filesystem;

namespace {

void require_count(const fs::path& list, std::size_t found, std::size_t pictures) {
  if (found == pictures) return;
  throw core::BadInput(list.string() + ": " + std::to_string(found) + " lights, but there are " +
                       std::to_string(pictures) + " pictures; every picture needs one line");
}

// The benchmark's pictures are called 001.png and so on after their line in light_directions.txt; copies of
// it without filenames.txt rely on that.
std::vector<TextLine> numbered_names(std::size_t count, const fs::path& lights) {
  std::vector<TextLine> names;
  for (std::size_t i = 1; i <= count; ++i) {
    const std::string digits = std::to_string(i);
    const std::string name = std::string(digits.size() < 3 ? 3 - digits.size() : 0, '0') + digits + ".png";
    names.push_back({name, lights.string() + ": light " + digits + " (there is no filenames.txt)"});
  }
  return names;
}

}  // namespace

PictureSet read_diligent_set(const fs::path& path) {
  require_folder(path);
  std::error_code none;
  const fs::path directions_file = path / "light_directions.txt";
  const fs::path names_file = path / "filenames.txt";
  const fs::path intensities_file = path / "light_intensities.txt";
  const std::vector<TextLine> directions = read_lines(directions_file);
  if (directions.empty()) throw core::BadInput(directions_file.string() + ": no lights in it");
  const std::vector<TextLine> names =
      fs::exists(names_file, none) ? read_lines(names_file) : numbered_names(directions.size(), directions_file);
  require_count(directions_file, directions.size(), names.size());

  PictureSet set;
  set.format = "diligent";
  set.source = path;
  set.encoding = core::Encoding::kLinear;
  for (std::size_t i = 0; i < names.size(); ++i) {
    const auto [x, y, z] = three_numbers(directions[i]);
    set.pictures.push_back(
        {find_listed_file(path, names[i].text, names[i].place), direction_at({x, y, z}, directions[i].place)});
  }
  if (fs::exists(intensities_file, none)) {
    const std::vector<TextLine> intensities = read_lines(intensities_file);
    require_count(intensities_file, intensities.size(), names.size());
    for (std::size_t i = 0; i < names.size(); ++i) {
      set.pictures[i].intensity = three_numbers(intensities[i]);
      require_positive(set.pictures[i].intensity, intensities[i].place);
    }
  }
  require_distinct(set);
  set.mask = mask_beside(path);
  return set;
}

}  // namespace lightstage::db
