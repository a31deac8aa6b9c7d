// The layout of the Extended Yale Face Database B (Georghiades et al. 2001, "From few to many"; Lee et al.
// 2005).
#include <regex>
#include <set>

#include "core/error.h"
#include "core/text.h"
#include "db/import/picture_set.h"
#include "db/importers.h"

namespace lightstage::db {

namespace fs = std::filesystem;

PictureSet read_yale_set(const fs::path& path) {
  require_folder(path);
  static const std::regex kLit(R"((.+_P\d\d)A([+-]\d{3})E([+-]\d\d)\.pgm)");
  static const std::regex kAmbient(R"((.+_P\d\d)_Ambient\.pgm)");
  PictureSet set;
  set.format = "yale";
  set.source = path;
  // The camera has a linear response (Georghiades et al. 2001, section 4.1).
  set.encoding = core::Encoding::kLinear;
  std::set<std::string> poses;
  std::error_code error;
  for (fs::directory_iterator file(path, error), end; !error && file != end; file.increment(error)) {
    const fs::directory_entry& entry = *file;
    const std::string name = entry.path().filename().string();
    std::smatch parts;
    if (std::regex_match(name, parts, kAmbient)) {
      poses.insert(parts[1].str());
      set.ambient = entry.path();
    } else if (std::regex_match(name, parts, kLit)) {
      poses.insert(parts[1].str());
      const double azimuth = core::parse_number(parts[2].str()).value();
      const double elevation = core::parse_number(parts[3].str()).value();
      if (std::abs(azimuth) > 180 || std::abs(elevation) > 90) {
        throw core::BadInput(entry.path().string() + ": azimuth or elevation in the name is out of range");
      }
      // Positive azimuth is light from image left, which is -x.
      set.pictures.push_back({entry.path(), core::Direction::from_longitude_latitude_degrees(-azimuth, elevation)});
    }
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
  if (set.ambient) {
    const core::ImageSize ambient = core::read_image_size(*set.ambient);
    const core::ImageSize lit = core::read_image_size(set.pictures.front().path);
    if (ambient != lit) {
      throw core::BadInput(set.ambient->string() + ": the ambient picture is " + std::to_string(ambient.width) + "x" +
                           std::to_string(ambient.height) + " pixels, the set " + std::to_string(lit.width) + "x" +
                           std::to_string(lit.height) + "; remove it or put one of the set's size there");
    }
  }
  return set;
}

}  // namespace lightstage::db
