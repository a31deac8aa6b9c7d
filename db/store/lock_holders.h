// Who keeps others waiting.
#pragma once

#include <filesystem>
#include <string>

namespace lightstage::db {

// Those that write to the store at this moment, as the system's table of file locks has it: "process 4711 (lightstage align head)", several joined by
// commas; empty where nobody does (any more) or the system does not say. Opens no file of the catalogue: closing one would give back the locks that this
// process holds on it.
std::string lock_holders(const std::filesystem::path& store_folder);

// Those that hold a core::FileLock of this folder, in the same words.
std::string folder_lock_holders(const std::filesystem::path& folder);

}  // namespace lightstage::db
