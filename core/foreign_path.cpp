#include "core/foreign_path.h"

#include <algorithm>
#include <system_error>

#include "core/error.h"
#include "core/printable.h"

namespace lightstage::core {

namespace fs = std::filesystem;

namespace {

constexpr std::size_t kLongestPath = 4095, kLongestPart = 255;  // Linux: PATH_MAX without its zero, NAME_MAX

// Whether the path is the folder or below it once all links are followed. What is not there yet is where its name says.
bool stays_inside(const fs::path& folder, const fs::path& path) {
  std::error_code error;
  const fs::path root = fs::canonical(folder.empty() ? fs::path(".") : folder, error);
  if (error) return true;  // there is no folder, so nothing to be led out to
  // A link to nothing leads nowhere that could be known.
  for (fs::path part = path; part.has_relative_path() && part != folder; part = part.parent_path()) {
    if (fs::is_symlink(part, error) && !fs::exists(part, error)) return false;
  }
  const fs::path target = fs::weakly_canonical(fs::absolute(path, error), error);
  if (error) return false;
  return std::mismatch(root.begin(), root.end(), target.begin(), target.end()).first == root.end();
}

}  // namespace

std::optional<std::string> objection_to_name(const fs::path& folder, std::string_view name) {
  if (name.empty()) return "names no file";
  const auto is_control = [](unsigned char c) { return c < 0x20 || c == 0x7F; };
  if (std::any_of(name.begin(), name.end(), is_control))
    return "holds a control character, which no file's name should";
  const fs::path path = name;
  const auto too_long = [](const fs::path& part) { return part.native().size() > kLongestPart; };
  if (name.size() > kLongestPath || std::any_of(path.begin(), path.end(), too_long)) {
    return "is longer than a file's name can be";
  }
  const bool leaves = path.is_absolute() || std::find(path.begin(), path.end(), "..") != path.end() ||
                      !stays_inside(folder, folder / path);
  if (leaves) return "leads out of the folder";
  return std::nullopt;
}

fs::path path_inside(const fs::path& folder, std::string_view name, const std::string& place) {
  if (const auto objection = objection_to_name(folder, name)) {
    throw BadInput(place + ": " + quoted(name) + " " + *objection +
                   "; such a file names what lies in its own folder, or below");
  }
  return folder / fs::path(name);
}

}  // namespace lightstage::core
