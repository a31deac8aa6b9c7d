// Where copies of a store lie, and the catalogues that a backup keeps.
//
// A backup whose catalogue had rows that the store has no more (a scan that was removed, an older store that was restored, a repair with a loss) keeps that
// catalogue beside the new one, as store.sqlite.before-TIME. Its objects stay, and it can be named wherever a backup can.
#pragma once

#include <filesystem>
#include <optional>
#include <set>
#include <string>

#include <SQLiteCpp/Database.h>

#include "core/file_lock.h"
#include "core/scratch_folder.h"
#include "db/content_hash.h"
#include "db/store/object_files.h"

namespace lightstage::db {

// What a user names as a backup: its folder, or a catalogue kept in one. Throws UsageError for what is neither.
struct BackupPlace {
  explicit BackupPlace(const std::filesystem::path& named);
  std::filesystem::path folder;                              // with the objects
  std::optional<std::filesystem::path> kept = std::nullopt;  // the catalogue, where it is not the folder's own
};

// Its catalogue, opened; a kept one is copied for that and stays as it is. Throws as open_catalogue, and StoreError for a kept one with damaged pages.
class BackupCatalogue {
 public:
  explicit BackupCatalogue(const BackupPlace& place);

  SQLite::Database take() && { return std::move(database_); }
  SQLite::Database& database() { return database_; }

 private:
  std::optional<core::ScratchFolder> copied_;
  SQLite::Database database_;
};

// The file of a catalogue that is open, however it was named.
std::filesystem::path file_of(const SQLite::Database& database);

// A name that is not taken, for keeping a backup's catalogue of this moment.
std::filesystem::path place_for_kept(const std::filesystem::path& folder);
// Objects that the catalogues kept in this folder refer to. Throws as BackupCatalogue.
std::set<ContentHash> objects_of_kept(const std::filesystem::path& folder);

// Held by who copies objects into a folder, and by who collects garbage there: a copy under way has objects, some of them old, that no catalogue of the
// folder knows yet. Throws StoreError naming the process that holds it.
core::FileLock lock_objects(const std::filesystem::path& folder);

// How many objects a catalogue refers to, and how many of them are among these files.
struct ObjectsHere {
  std::size_t all = 0, here = 0;
};
ObjectsHere objects_here(SQLite::Database& catalogue, const ObjectFiles& files);

// What keeps `store gc` from removing anything: a damaged catalogue or log that was put aside, or the mark that there was none to put aside
// (store.sqlite.missing-N); nothing where there is neither.
std::optional<std::filesystem::path> holds_garbage(const std::filesystem::path& store_folder);

}  // namespace lightstage::db
