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

// The file of a product of kind "weights".
std::filesystem::path weights_file(const db::Product& weights);

// A checkpoint that needs no store: the file of that path, or the shipped one by the name `blend`; nothing for other names.
std::optional<std::filesystem::path> file_or_shipped_model(const std::string& file_or_name);

// That, or the model of that name in the store. UsageError for a name that is none of these.
std::filesystem::path find_model(const db::Store& store, const std::string& file_or_name);

// Which models newest_model may take.
struct ModelFilter {
  std::optional<model::Architecture> architecture = {};
  // By the validation errors on record, where there are any; others are left out with a warning.
  bool better_than_rbf = false;
  bool adapted = true;  // those that `superres --adapt` made, too
};

// The newest model of the store that was trained on the scan; nothing when there is none. Files that cannot be read, or are no longer the ones
// that were entered, are left out with a warning.
std::optional<std::filesystem::path> newest_model(const db::Store& store, db::Id scan_id,
                                                  const ModelFilter& filter = {});

// Where `superres --adapt` keeps its models.
std::filesystem::path adapted_models_folder(const db::Store& store);

}  // namespace lightstage::cli
