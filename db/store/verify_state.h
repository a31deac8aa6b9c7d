// What a verification of the whole store had found sound when it was interrupted: verify.json in the store's folder.
#pragma once

#include <filesystem>
#include <map>
#include <optional>
#include <string>

#include "db/store.h"

namespace lightstage::db {

// The file may lie or be of another time, so nothing in it is believed but that what it describes was read: scans are there with all that the check of them looked at, as one hash, and only those in
// which nothing was wrong. A scan that has changed since, or of which anything was to be said, is checked again; texts and counts are not kept.
struct VerifyState {
  std::string store_id;
  std::map<Id, ContentHash> sound;  // by scan: the hash of its contents (db/store/verify.cpp)
};

// Nothing when there is none, or it is not readable as one.
std::optional<VerifyState> read_verify_state(const std::filesystem::path& store_folder);
// A store that cannot be written to goes without.
void write_verify_state(const std::filesystem::path& store_folder, const VerifyState& state);
void remove_verify_state(const std::filesystem::path& store_folder);

}  // namespace lightstage::db
