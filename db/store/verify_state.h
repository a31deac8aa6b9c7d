// What a verification of the whole store had done when it was interrupted: verify.json in the store's folder.
#pragma once

#include <filesystem>
#include <optional>
#include <set>
#include <string>

#include "db/store.h"

namespace lightstage::db {

struct VerifyState {
  std::set<Id> scans_done;
  VerifyReport report;  // so far
};

// Nothing when there is none, or it is not readable as one.
std::optional<VerifyState> read_verify_state(const std::filesystem::path& store_folder);
// A store that cannot be written to goes without.
void write_verify_state(const std::filesystem::path& store_folder, const VerifyState& state);
void remove_verify_state(const std::filesystem::path& store_folder);

}  // namespace lightstage::db
