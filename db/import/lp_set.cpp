// RTI .lp files: a count, then `picture x y z` a line.
#include "core/light_list.h"
#include "db/import/listed_file.h"
#include "db/import/picture_set.h"
#include "db/importers.h"

namespace lightstage::db {

namespace fs = std::filesystem;

PictureSet read_lp_set(const fs::path& path) {
  const std::vector<core::LpEntry> entries = core::read_lp(path);
  const fs::path folder = folder_of(path);
  PictureSet set;
  set.format = "lp";
  set.source = path;
  for (std::size_t i = 0; i < entries.size(); ++i) {
    const std::string place =
        path.string() + ": light " + std::to_string(i + 1) + " of " + std::to_string(entries.size());
    set.pictures.push_back({find_listed_file(folder, entries[i].name, place), entries[i].direction});
  }
  require_distinct(set);
  set.mask = mask_beside(folder);
  return set;
}

}  // namespace lightstage::db
