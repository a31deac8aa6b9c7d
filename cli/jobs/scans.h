// Scans and models by name.
#pragma once

#include <filesystem>
#include <optional>
#include <string>

#include "db/scan_loader.h"
#include "db/store.h"
#include "model/checkpoint.h"

namespace lightstage::cli {

// As db::load_scan; a captured scan whose stage was never calibrated gets the lights as drawn in its stage file, with a warning.
db::LoadedScan load_scan(const db::Store& store, const std::string& name, const std::string& camera = {});

// A checkpoint that needs no store: the file of that path, or the shipped one by the name `blend`; nothing for other names.
std::optional<std::filesystem::path> file_or_shipped_model(const std::string& file_or_name);

// That, or the model of that name in the store. UsageError for a name that is none of these.
std::filesystem::path find_model(const db::Store& store, const std::string& file_or_name);

// The newest model of the store that was trained on the scan, of this architecture where one is given; nothing when there is none. Files that cannot be
// read are left out with a warning.
std::optional<std::filesystem::path> newest_model(const db::Store& store, db::Id scan_id,
                                                  std::optional<model::Architecture> architecture = {});

}  // namespace lightstage::cli
