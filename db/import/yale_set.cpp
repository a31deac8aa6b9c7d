// The layout of the Extended Yale Face Database B (Georghiades et al. 2001, "From few to many"; Lee et al.
// 2005).
#include <algorithm>
#include <optional>
#include <set>

#include "core/error.h"
#include "core/foreign_path.h"
#include "core/text.h"
#include "db/import/picture_set.h"
#include "db/importers.h"

namespace lightstage::db {

namespace fs = std::filesystem;

namespace {

struct Name {
  std::string pose;  // NAME_Pnn
  bool ambient = false;
  double azimuth = 0, elevation = 0;  // degrees
};

// NAME_PnnA+000E+00.pgm or NAME_Pnn_Ambient.pgm; nothing for any other file.
std::optional<Name> parse_name(const fs::path& file) {
  if (file.extension() != ".pgm") return std::nullopt;
  const std::string stem = file.stem().string();
  constexpr std::string_view kAmbient = "_Ambient";
  if (stem.ends_with(kAmbient)) return Name{stem.substr(0, stem.size() - kAmbient.size()), true};
  constexpr std::size_t kAngles = std::string_view("A+000E+00").size();
  if (stem.size() <= kAngles) return std::nullopt;
  const std::string_view angles = std::string_view(stem).substr(stem.size() - kAngles);
  const auto azimuth = core::parse_integer(angles.substr(1, 4));
  const auto elevation = core::parse_integer(angles.substr(6, 3));
  if (angles[0] != 'A' || angles[5] != 'E' || !azimuth || !elevation) return std::nullopt;
  return Name{stem.substr(0, stem.size() - kAngles), false, double(*azimuth), double(*elevation)};
}

void require_size_of_set(const fs::path& ambient_path, const fs::path& lit_path) {
  const core::ImageSize ambient = core::read_image_size(ambient_path);
  const core::ImageSize lit = core::read_image_size(lit_path);
  if (ambient == lit) return;
  throw core::BadInput(ambient_path.string() + ": the ambient picture is " + std::to_string(ambient.width) + "x" +
                       std::to_string(ambient.height) + " pixels, the set " + std::to_string(lit.width) + "x" +
                       std::to_string(lit.height) + "; remove it or put one of the set's size there");
}

}  // namespace

PictureSet read_yale_set(const fs::path& path) {
  require_folder(path);
  PictureSet set;
  set.format = "yale";
  set.source = path;
  // The camera has a linear response (Georghiades et al. 2001, section 4.1).
  set.encoding = core::Encoding::kLinear;
  std::set<std::string> poses;
  std::error_code error;
  for (fs::directory_iterator entry(path, error), end; !error && entry != end; entry.increment(error)) {
    const std::optional<Name> name = parse_name(entry->path());
    if (!name) continue;
    const fs::path file = core::path_inside(path, entry->path().filename().native(), path.string());
    poses.insert(name->pose);
    if (name->ambient) {
      set.ambient = file;
      continue;
    }
    if (std::abs(name->azimuth) > 180 || std::abs(name->elevation) > 90) {
      throw core::BadInput(file.string() + ": azimuth or elevation in the name is out of range");
    }
    // Positive azimuth is light from image left, which is -x.
    set.pictures.push_back({file, core::Direction::from_longitude_latitude_degrees(-name->azimuth, name->elevation)});
  }
  if (error) throw core::BadInput(path.string() + ": cannot be listed: " + error.message());
  if (set.pictures.empty()) {
    throw core::BadInput(path.string() +
                         ": no picture named NAME_PnnA<azimuth>E<elevation>.pgm, such as yaleB01_P00A+005E-10.pgm");
  }
  if (poses.size() > 1) {
    throw core::BadInput(path.string() + ": pictures of several subjects or poses ('" + *poses.begin() + "', '" +
                         *std::next(poses.begin()) + "'); give each its own folder");
  }
  // A folder has no order of its own.
  std::sort(set.pictures.begin(), set.pictures.end(), [](const auto& a, const auto& b) { return a.path < b.path; });
  if (set.ambient) require_size_of_set(*set.ambient, set.pictures.front().path);
  return set;
}

}  // namespace lightstage::db
