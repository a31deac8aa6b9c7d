// Folders that nobody needs any more.
#pragma once

#include <filesystem>

namespace lightstage::core {

// Removes a folder with everything in it, as far as that can be done; for destructors. std::filesystem's own with an error_code ends the program where
// memory is short.
void remove_folder_quietly(const std::filesystem::path& folder) noexcept;

}  // namespace lightstage::core
