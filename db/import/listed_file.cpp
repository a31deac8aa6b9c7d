#include "db/import/listed_file.h"

#include <algorithm>

#include "core/error.h"

namespace lightstage::db {

namespace fs = std::filesystem;

namespace {

// Whether the file is in the folder or below it once all links are followed.
bool is_inside(const fs::path& folder, const fs::path& file) {
  std::error_code error;
  const fs::path root = fs::canonical(folder, error);
  if (error) return false;
  const fs::path target = fs::canonical(file, error);
  if (error) return false;
  return std::mismatch(root.begin(), root.end(), target.begin(), target.end()).first == root.end();
}

bool is_there(const fs::path& file) {
  std::error_code none;
  return fs::is_regular_file(file, none);
}

}  // namespace

fs::path find_listed_file(const fs::path& folder, std::string listed, const std::string& place) {
  std::replace(listed.begin(), listed.end(), '\\', '/');
  const fs::path path = listed;
  const bool leaves = path.is_absolute() || std::find(path.begin(), path.end(), "..") != path.end() ||
                      (is_there(folder / path) && !is_inside(folder, folder / path));
  if (!leaves && is_there(folder / path)) return folder / path;
  const fs::path beside = folder / path.filename();
  if (!path.filename().empty() && is_there(beside) && is_inside(folder, beside)) return beside;
  if (leaves)
    throw core::BadInput(place + ": '" + listed + "' leads out of the folder; put the picture beside the list");
  throw core::BadInput(place + ": the picture '" + listed + "' is not there");
}

std::optional<fs::path> mask_beside(const fs::path& folder) {
  const fs::path mask = folder / "mask.png";
  if (!is_there(mask)) return std::nullopt;
  return mask;
}

}  // namespace lightstage::db
