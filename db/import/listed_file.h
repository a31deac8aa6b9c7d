// Files that a list from somewhere else names.
#pragma once

#include <filesystem>
#include <optional>
#include <string>

namespace lightstage::db {

// The file that a list in `folder` calls `listed` ('/' or '\\' between folders). A path that core/foreign_path.h refuses, since it leaves
// the folder, is not followed; like one that is not there, it is looked for by its file name alone, beside the list. Throws BadInput that
// begins with `place` (the list's file and line) when that fails too.
std::filesystem::path find_listed_file(const std::filesystem::path& folder, std::string listed,
                                       const std::string& place);

// FOLDER/mask.png where it exists. Throws BadInput when it is a symbolic link out of the folder.
std::optional<std::filesystem::path> mask_beside(const std::filesystem::path& folder);

}  // namespace lightstage::db
