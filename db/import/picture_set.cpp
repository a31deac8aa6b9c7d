#include "db/import/picture_set.h"

#include <map>

#include "core/error.h"

namespace lightstage::db {

namespace fs = std::filesystem;

fs::path folder_of(const fs::path& file) {
  return file.has_parent_path() ? file.parent_path() : fs::path(".");
}

void require_folder(const fs::path& folder) {
  std::error_code none;
  if (!fs::is_directory(folder, none)) throw core::BadInput(folder.string() + ": there is no such folder");
}

void require_distinct(const PictureSet& set) {
  std::map<fs::path, std::size_t> first_light;
  for (std::size_t i = 0; i < set.pictures.size(); ++i) {
    const auto [entry, is_new] = first_light.emplace(set.pictures[i].path.lexically_normal(), i);
    if (!is_new) {
      throw core::BadInput(set.source.string() + ": lights " + std::to_string(entry->second + 1) + " and " +
                           std::to_string(i + 1) + " both name the picture '" +
                           set.pictures[i].path.filename().string() + "'");
    }
  }
}

}  // namespace lightstage::db
