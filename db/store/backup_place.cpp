#include "db/store/backup_place.h"

#include <SQLiteCpp/Statement.h>
#include <sqlite3.h>

#include "core/clock.h"
#include "core/error.h"
#include "core/file.h"
#include "db/store/catalogue.h"
#include "db/store/lock_holders.h"
#include "db/store/log_damage.h"
#include "db/store/page_checks.h"
#include "db/store/store_folder.h"

namespace lightstage::db {

namespace fs = std::filesystem;

namespace {

constexpr const char* kKeptSuffix = ".before-";

bool is_named(const fs::path& file, const char* suffix) {
  return file.filename().string().starts_with(catalogue_path({}).string() + suffix);
}

bool is_kept(const fs::path& file) {
  std::error_code none;
  return is_named(file, kKeptSuffix) && fs::symlink_status(file, none).type() == fs::file_type::regular;
}

template <class Use>
void each_object(SQLite::Database& catalogue, const Use& use) {
  SQLite::Statement row(catalogue, "SELECT object FROM frames UNION SELECT object FROM product_images");
  while (row.executeStep()) use(ContentHash::from_hex(row.getColumn(0).getString()));
}

}  // namespace

BackupPlace::BackupPlace(const fs::path& named) : folder(named) {
  std::error_code none;
  if (is_kept(named)) {
    kept = named;
    folder = named.has_parent_path() ? named.parent_path() : fs::path(".");
  }
  if (!fs::is_directory(folder / "objects", none)) {
    throw core::UsageError(
        (named.empty() ? "''" : named.string()) +
        ": there is no backup here (no folder objects in it); name the folder that `lightstage store backup` was "
        "given");
  }
  require_own_folders(folder);
}

BackupCatalogue::BackupCatalogue(const BackupPlace& place)
    : database_([&] {
        if (!place.kept) return open_catalogue(place.folder);
        if (!damaged_pages(*place.kept).empty()) {
          throw core::StoreError(place.kept->string() + ": this catalogue is damaged");
        }
        copied_.emplace(core::temporary_folder());
        std::error_code error;
        fs::copy_file(*place.kept, catalogue_path(copied_->path()), error);
        if (error) throw core::StoreError(place.kept->string() + ": cannot be copied: " + error.message());
        return open_catalogue(copied_->path());
      }()) {}

fs::path file_of(const SQLite::Database& database) {
  return sqlite3_db_filename(database.getHandle(), "main");
}

fs::path place_for_kept(const fs::path& folder) {
  std::string time = core::utc_timestamp();
  std::erase_if(time, [](char c) { return c == '-' || c == ':'; });
  const std::string name = catalogue_path(folder).string() + kKeptSuffix + time;
  std::error_code none;
  fs::path place = name;
  for (int i = 2; fs::exists(place, none); ++i) place = name + "-" + std::to_string(i);
  return place;
}

std::set<ContentHash> objects_of_kept(const fs::path& folder) {
  std::set<ContentHash> objects;
  for (const auto& entry : fs::directory_iterator(folder)) {
    if (!is_kept(entry.path())) continue;
    BackupCatalogue kept{BackupPlace(entry.path())};
    each_object(kept.database(), [&](const ContentHash& hash) { objects.insert(hash); });
  }
  return objects;
}

core::FileLock lock_objects(const fs::path& folder) {
  std::optional<core::FileLock> alone = core::FileLock::try_lock(folder);
  if (!alone) {
    const std::string holders = folder_lock_holders(folder);
    throw core::StoreError(
        folder.string() + ": " + (holders.empty() ? "another program" : holders) +
        " is at work on the objects in this folder (a backup, `store gc`); try again when it is done");
  }
  return *std::move(alone);
}

ObjectsHere objects_here(SQLite::Database& catalogue, const ObjectFiles& files) {
  ObjectsHere counts;
  each_object(catalogue, [&](const ContentHash& hash) {
    ++counts.all;
    counts.here += files.exists(hash) ? 1 : 0;
  });
  return counts;
}

std::optional<fs::path> holds_garbage(const fs::path& store_folder) {
  const std::string log = log_path({}).string() + kDamagedSuffix;
  for (const auto& entry : fs::directory_iterator(store_folder)) {
    if (is_named(entry.path(), kDamagedSuffix) || is_named(entry.path(), kMissingSuffix) ||
        entry.path().filename().string().starts_with(log))
      return entry.path();
  }
  return std::nullopt;
}

}  // namespace lightstage::db
