// Names of files made durable.
#pragma once

#include <filesystem>

namespace lightstage::core {

// Syncs the names in a folder, as renaming or making a file there changes them. Of a folder that has not changed it costs next to nothing. Throws
// BadInput naming the folder when the disk fails.
void sync_folder(const std::filesystem::path& folder);

}  // namespace lightstage::core
