// Store: copies of the whole.
#include <SQLiteCpp/Backup.h>

#include <algorithm>
#include <atomic>
#include <mutex>
#include <set>

#include "core/disk_space.h"
#include "core/error.h"
#include "core/file.h"
#include "core/foreign_path.h"
#include "core/interrupt.h"
#include "core/parallel.h"
#include "core/printable.h"
#include "core/progress.h"
#include "db/store/impl.h"
#include "db/store/page_checks.h"
#include "db/store/scan_contents.h"

namespace lightstage::db {

namespace fs = std::filesystem;

namespace {

constexpr std::uintmax_t kFileOverhead = 4096;  // of the file system: files take whole blocks

std::string store_id(SQLite::Database& database) {
  return database.execAndGet("SELECT store_id FROM identity").getString();
}

bool same_place(const fs::path& a, const fs::path& b) {
  std::error_code error;
  return fs::equivalent(a, b, error) && !error;
}

std::vector<OwnedObject> all_objects(SQLite::Database& database) {
  std::vector<OwnedObject> objects = objects_of_no_scan(database);
  SQLite::Statement scan(database, "SELECT id FROM scans ORDER BY id");
  while (scan.executeStep()) {
    std::vector<OwnedObject> own = objects_of_scan(database, scan.getColumn(0).getInt64());
    objects.insert(objects.end(), std::make_move_iterator(own.begin()), std::make_move_iterator(own.end()));
  }
  std::stable_sort(objects.begin(), objects.end(),
                   [](const OwnedObject& a, const OwnedObject& b) { return a.hash < b.hash; });
  objects.erase(std::unique(objects.begin(), objects.end(),
                            [](const OwnedObject& a, const OwnedObject& b) { return a.hash == b.hash; }),
                objects.end());
  return objects;
}

// The catalogue as it is at one moment, in a file of its own.
class Snapshot {
 public:
  Snapshot(SQLite::Database& source, const fs::path& folder) : path_(folder / "incoming.sqlite") {
    remove();
    SQLite::Database copy = open_checked(path_, SQLite::OPEN_READWRITE | SQLite::OPEN_CREATE);
    SQLite::Backup(copy, source).executeStep();
  }
  ~Snapshot() { remove(); }
  Snapshot(const Snapshot&) = delete;
  Snapshot& operator=(const Snapshot&) = delete;

  const fs::path& path() const { return path_; }
  std::vector<OwnedObject> objects() const {
    SQLite::Database database = open();
    return all_objects(database);
  }

  // Makes it the folder's catalogue: whole or not at all, and to programs that read the earlier one in one transaction.
  void install() const {
    const fs::path target = path_.parent_path() / catalogue_path({});
    std::error_code none;
    if (!fs::exists(target, none) || fs::is_empty(target, none)) {
      put_catalogue(path_, path_.parent_path());
      return;
    }
    SQLite::Database earlier = open_checked(target, SQLite::OPEN_READWRITE);
    SQLite::Database source = open();
    earlier.exec("PRAGMA synchronous = FULL");
    SQLite::Backup(earlier, source).executeStep();
  }

 private:
  SQLite::Database open() const { return open_checked(path_, SQLite::OPEN_READWRITE); }
  void remove() const {
    std::error_code ignored;
    for (const char* suffix : {"", "-wal", "-shm", "-journal"}) fs::remove(path_.string() + suffix, ignored);
  }
  fs::path path_;
};

// Networks that the store keeps: few and replaced whole, told apart by size and time as by make.
void copy_models(const fs::path& from, const fs::path& to, BackupReport& report) {
  const fs::path models = from / "models";
  if (!fs::exists(models)) return;
  for (const fs::directory_entry& entry : fs::recursive_directory_iterator(models)) {
    if (entry.is_symlink() || !entry.is_regular_file()) continue;  // what a link names is no part of the store
    const fs::path name = fs::relative(entry.path(), from), target = to / name;
    if (const auto objection = core::objection_to_name(to, name.native())) {
      throw core::StoreError(to.string() + ": " + core::quoted(name.native()) + " " + *objection +
                             "; nothing is written there");
    }
    std::error_code none;
    if (fs::exists(target, none) && fs::file_size(target) == entry.file_size() &&
        fs::last_write_time(target) == entry.last_write_time())
      continue;
    core::make_folder(target.parent_path());
    core::replace_file_atomically(target, [&](const fs::path& temporary) { fs::copy_file(entry.path(), temporary); });
    fs::last_write_time(target, entry.last_write_time());
    report.copied_bytes += entry.file_size();
  }
}

// Throws StoreError where the backup's disk has no room for what is to be copied: objects that it lacks, and twice the catalogue (beside the one that it replaces).
void require_room_for(const std::vector<OwnedObject>& objects, const ObjectFiles& from, const ObjectFiles& to,
                      std::uintmax_t catalogue) {
  std::uintmax_t bytes = 2 * catalogue;
  for (const OwnedObject& object : objects) {
    std::error_code none;
    if (fs::exists(to.path(object.hash), none)) continue;
    const std::uintmax_t size = fs::file_size(from.path(object.hash), none);
    if (!none) bytes += size + kFileOverhead;
  }
  core::require_room(to.folder(), bytes, "the backup");
}

}  // namespace

BackupReport Store::back_up(const fs::path& folder) const {
  if (same_place(folder, this->folder())) {
    throw core::UsageError(folder.string() + ": this is the store itself; a backup goes to another folder");
  }
  if (const auto damaged = damaged_pages(catalogue_path(this->folder())); !damaged.empty()) {
    throw core::StoreError(
        this->folder().string() + ": page " + std::to_string(damaged[0]) +
        " of the catalogue does not match its checksum; nothing was copied. `lightstage store repair` says what to do");
  }
  require_own_folders(folder);
  BackupReport report;
  explaining(folder, [&] {
    core::make_folder(folder / "objects");
    std::error_code none;
    if (fs::exists(catalogue_path(folder), none) && !fs::is_empty(catalogue_path(folder), none)) {
      SQLite::Database earlier = open_catalogue(folder);
      if (store_id(earlier) != store_id(impl_->database)) {
        throw core::UsageError(folder.string() + ": there is another store in this folder, not a backup of " +
                               this->folder().string() + "; choose a folder of its own");
      }
    }
    const Snapshot snapshot(impl_->database, folder);
    const std::vector<OwnedObject> objects = snapshot.objects();
    report.objects = objects.size();
    const ObjectFiles files(folder);
    require_room_for(objects, impl_->objects, files, fs::file_size(snapshot.path()));
    std::vector<std::string> problems(objects.size());
    std::atomic<std::size_t> copied = 0;
    std::atomic<std::uint64_t> bytes = 0;
    core::Progress progress("copying objects", objects.size());
    core::parallel_for(objects.size(), 1, [&](std::size_t first, std::size_t last) {
      for (std::size_t i = first; i < last; ++i) {
        core::throw_if_interrupted();
        const OwnedObject& object = objects[i];
        progress.advance();
        std::error_code ignored;
        if (fs::exists(files.path(object.hash), ignored)) continue;
        if (const auto problem = impl_->objects.problem(object.hash)) {
          problems[i] = object.owner + ": object " + object.hash.hex() + " " + *problem;
          continue;
        }
        bytes += files.adopt(impl_->objects.path(object.hash), object.hash);
        ++copied;
      }
    });
    for (std::string& problem : problems) {
      if (!problem.empty()) report.damaged.push_back(std::move(problem));
    }
    report.copied = copied;
    report.copied_bytes = bytes;
    copy_models(this->folder(), folder, report);
    snapshot.install();
  });
  sync_folder(folder);
  return report;
}

BackupReport Store::restore(const fs::path& backup, const fs::path& folder) {
  std::error_code none;
  if (fs::exists(catalogue_path(folder), none) && !fs::is_empty(catalogue_path(folder), none)) {
    throw core::UsageError(folder.string() +
                           ": there is a store already; restore into a new folder, or mend this one with `lightstage "
                           "store repair --from " +
                           backup.string() + "`");
  }
  require_own_folders(backup);
  if (!fs::exists(catalogue_path(backup), none)) {
    throw core::StoreError(backup.string() +
                           ": there is no backup here (no store.sqlite in it); name the folder that `lightstage store "
                           "backup` was given");
  }
  const Store source = open(backup);
  return source.back_up(folder);
}

}  // namespace lightstage::db
