// Scans and models by name.
#pragma once

#include <filesystem>
#include <optional>
#include <string>

#include "db/scan_loader.h"
#include "db/store.h"

namespace lightstage::cli {

// As db::load_scan; a captured scan whose stage was never calibrated gets the lights as drawn in its stage file, with a warning.
db::LoadedScan load_scan(const db::Store& store, const std::string& name, const std::string& camera = {});

// A checkpoint: the file of that path, or the model of that name in the store. For an empty name the newest model that was
// trained on the scan; nothing when there is none. UsageError for a name that is neither.
std::optional<std::filesystem::path> find_model(const db::Store& store, const std::string& file_or_name,
                                                db::Id scan_id);

}  // namespace lightstage::cli
