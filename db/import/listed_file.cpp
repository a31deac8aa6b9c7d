#include "db/import/listed_file.h"

#include <algorithm>

#include "core/error.h"
#include "core/foreign_path.h"
#include "core/printable.h"

namespace lightstage::db {

namespace fs = std::filesystem;

namespace {

bool is_there(const fs::path& file) {
  std::error_code none;
  return fs::is_regular_file(file, none);
}

}  // namespace

fs::path find_listed_file(const fs::path& folder, std::string listed, const std::string& place) {
  std::replace(listed.begin(), listed.end(), '\\', '/');
  const std::optional<std::string> objection = core::objection_to_name(folder, listed);
  const fs::path path = listed;
  if (!objection && is_there(folder / path)) return folder / path;
  const fs::path beside = path.filename();
  if (!core::objection_to_name(folder, beside.native()) && is_there(folder / beside)) return folder / beside;
  if (objection)
    throw core::BadInput(place + ": " + core::quoted(listed) + " " + *objection + "; put the picture beside the list");
  std::error_code none;
  throw core::BadInput(place + ": the picture " + core::quoted(listed) +
                       (fs::exists(folder / path, none) ? " is not a file" : " is not there"));
}

std::optional<fs::path> mask_beside(const fs::path& folder) {
  const char* const kName = "mask.png";
  if (!is_there(folder / kName)) return std::nullopt;
  return core::path_inside(folder, kName, folder.string());
}

}  // namespace lightstage::db
