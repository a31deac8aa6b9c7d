// Files that another file names: a list of pictures, a description of balls, a rig of lights, a mesh and its textures.
//
// Such a file may come from anybody, so what it names must lie in its own folder or below it, also after all symbolic links are followed.
// What lies elsewhere is named on the command line, where it is the user's own wish, and may be anything there.
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <string_view>

namespace lightstage::core {

// Why `name` cannot be followed from `folder`, as the end of a sentence that begins with the name ("leads out of its folder"); nothing when
// it can, whether a file is there or not. Refused are names that are empty, absolute, hold "..", a NUL or another control character, are longer than
// the system's names may be, or come out of the folder by a symbolic link. Bytes that are not UTF-8 are names like others.
std::optional<std::string> objection_to_name(const std::filesystem::path& folder, std::string_view name);

// folder / name. Throws BadInput "PLACE: 'NAME' leads out of ..." for what objection_to_name refuses; `place` is the naming file, and line where
// there is one.
std::filesystem::path path_inside(const std::filesystem::path& folder, std::string_view name, const std::string& place);

}  // namespace lightstage::core
