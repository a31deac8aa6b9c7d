// Opening store.sqlite: looking before touching, and the settings of every connection.
#pragma once

#include <filesystem>

#include <SQLiteCpp/Database.h>
#include <SQLiteCpp/Exception.h>

#include "core/error.h"

namespace lightstage::db {

std::filesystem::path catalogue_path(const std::filesystem::path& store_folder);
// Whether there is one that holds anything, whatever it is: an empty file is none.
bool has_catalogue(const std::filesystem::path& store_folder);

// A new, empty catalogue. Throws UsageError when there is one already, or objects that it would not know.
SQLite::Database create_catalogue(const std::filesystem::path& store_folder);
// An existing one, migrated. Throws StoreError when it is missing, no store, or newer than this program; a
// newer one is not touched: no byte of it, of its journal or of its folder changes. On a file system that is mounted read-only it is opened for reading
// alone. On a full one, where SQLite has no room for a file that connections share, this one keeps all others away.
SQLite::Database open_catalogue(const std::filesystem::path& store_folder);

// Moves a catalogue that was made elsewhere on the same file system to its place, durably. Throws StoreError when the log of an earlier one lies there,
// which SQLite would take for its own.
void put_catalogue(const std::filesystem::path& made, const std::filesystem::path& store_folder);

// Throws StoreError when the file is a catalogue of a newer schema; says nothing of any other.
void throw_if_newer(const std::filesystem::path& store_folder);

// store.sqlite.damaged-1 and so on: catalogues that a repair has put aside.
inline constexpr const char* kDamagedSuffix = ".damaged-";
// store.sqlite.missing-1 and so on: the mark that a repair found no catalogue to put aside.
inline constexpr const char* kMissingSuffix = ".missing-";
// The first such name beside a file that is not taken.
std::filesystem::path numbered(const std::filesystem::path& file, const char* suffix);

// What a database error means for the user, with the store's path.
core::StoreError explained(const SQLite::Exception& error, const std::filesystem::path& store_folder);

// Calls `work`, with database errors turned into StoreError.
template <class Work>
decltype(auto) explaining(const std::filesystem::path& store_folder, Work&& work) {
  try {
    return work();
  } catch (const SQLite::Exception& error) {
    throw explained(error, store_folder);
  }
}

}  // namespace lightstage::db
