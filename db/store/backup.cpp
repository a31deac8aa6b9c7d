// Store: copies of the whole.
#include <SQLiteCpp/Backup.h>

#include <algorithm>
#include <atomic>
#include <mutex>
#include <optional>

#include "core/disk_space.h"
#include "core/error.h"
#include "core/file.h"
#include "core/foreign_path.h"
#include "core/interrupt.h"
#include "core/parallel.h"
#include "core/printable.h"
#include "core/progress.h"
#include "db/store/backup_place.h"
#include "db/store/catalogue_rows.h"
#include "db/store/impl.h"
#include "db/store/page_checks.h"
#include "db/store/scan_contents.h"

namespace lightstage::db {

namespace fs = std::filesystem;

namespace {

constexpr std::uintmax_t kFileOverhead = 4096;  // of the file system: files take whole blocks

// After all links, and whatever other names a folder is mounted under.
bool lies_in(const fs::path& inner, const fs::path& outer) {
  std::error_code error;
  fs::path place = fs::weakly_canonical(fs::absolute(inner), error);
  if (error) return false;
  while (true) {
    if (fs::equivalent(place, outer, error) && !error) return true;
    if (!place.has_relative_path()) return false;
    place = place.parent_path();
  }
}

// A copy in the store would be taken for what nothing refers to, and removed.
void require_apart(const fs::path& copy, const fs::path& store) {
  if (copy.empty()) throw core::UsageError("no folder is named for the copy");
  if (lies_in(copy, store)) {
    throw core::UsageError(copy.string() + ": this is the store itself or a folder in it (" + store.string() +
                           "); a copy goes to another folder");
  }
  if (lies_in(store, copy)) {
    throw core::UsageError(copy.string() + ": the store " + store.string() +
                           " lies in this folder; a copy goes to a folder of its own");
  }
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

// Not to be seen by others once it is gone out of scope, however it came to be made.
class Temporary {
 public:
  explicit Temporary(fs::path path) : path_(std::move(path)) { remove(); }
  ~Temporary() { remove(); }
  Temporary(const Temporary&) = delete;
  Temporary& operator=(const Temporary&) = delete;
  const fs::path& path() const { return path_; }

 private:
  void remove() const {
    std::error_code ignored;
    for (const char* suffix : {"", "-wal", "-shm", "-journal"}) fs::remove(path_.string() + suffix, ignored);
  }
  fs::path path_;
};

// A catalogue as it is at one moment, in a file of its own. Whoever makes one in a folder has its lock, so that what is there is left of an earlier one.
class Snapshot {
 public:
  Snapshot(SQLite::Database& source, const fs::path& folder)
      : file_(catalogue_path(folder).string() + ".incoming"), folder_(folder) {
    SQLite::Database copy = open_checked(file_.path(), SQLite::OPEN_READWRITE | SQLite::OPEN_CREATE);
    SQLite::Backup(copy, source).executeStep();
  }

  SQLite::Database open() const { return open_checked(file_.path(), SQLite::OPEN_READWRITE); }
  std::uintmax_t bytes() const { return fs::file_size(file_.path()); }

  // Makes it the folder's catalogue: whole or not at all, and to programs that read the earlier one in one transaction.
  void install() const {
    if (!has_catalogue(folder_)) {
      put_catalogue(file_.path(), folder_);
      return;
    }
    SQLite::Database earlier = open_checked(catalogue_path(folder_), SQLite::OPEN_READWRITE);
    SQLite::Database source = open();
    earlier.exec("PRAGMA synchronous = FULL");
    SQLite::Backup(earlier, source).executeStep();
  }

 private:
  Temporary file_;
  fs::path folder_;
};

// The catalogue of an earlier backup, about to be replaced.
class Earlier {
 public:
  // Nothing where the folder holds none. Throws as open_catalogue, and StoreError for a damaged one: nobody could say what it alone has.
  static std::optional<Earlier> in(const fs::path& folder, const fs::path& store) {
    if (!has_catalogue(folder)) return std::nullopt;
    Earlier earlier(folder);
    earlier.database_.exec("PRAGMA wal_checkpoint(PASSIVE)");
    if (const auto damaged = damaged_pages(catalogue_path(folder)); !damaged.empty()) {
      throw core::StoreError(folder.string() + ": page " + std::to_string(damaged[0]) +
                             " of the backup's catalogue does not match its checksum; nothing was copied. `lightstage "
                             "store repair --store " +
                             folder.string() + " --from " + store.string() + "` mends it");
    }
    return earlier;
  }

  SQLite::Database& database() { return database_; }
  std::uintmax_t bytes() const { return fs::file_size(catalogue_path(folder_)); }

  // Puts a copy of it aside when it has rows that the new one lacks.
  void keep_unless_contained(const Snapshot& incoming, BackupReport& report) {
    SQLite::Database now = incoming.open();
    report.gone = missing_rows(database_, now);
    if (report.gone.empty()) return;
    const Temporary made(catalogue_path(folder_).string() + ".keeping");
    {
      SQLite::Database copy = open_checked(made.path(), SQLite::OPEN_READWRITE | SQLite::OPEN_CREATE);
      SQLite::Backup(copy, database_).executeStep();
    }
    report.kept_catalogue = place_for_kept(folder_);
    core::move_file_durably(made.path(), report.kept_catalogue);
  }

 private:
  explicit Earlier(const fs::path& folder) : folder_(folder), database_(open_catalogue(folder)) {}
  fs::path folder_;
  SQLite::Database database_;
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

// Copies objects that the backup lacks.
class ObjectCopy {
 public:
  ObjectCopy(const ObjectFiles& from, const ObjectFiles& to) : from_(from), to_(to) {}

  // Throws StoreError where the backup's disk has no room for them, and for what comes besides.
  void require_room(const std::vector<OwnedObject>& objects, std::uintmax_t besides) const {
    std::uintmax_t bytes = besides;
    for (const OwnedObject& object : objects) {
      if (seems_there(object.hash)) continue;
      std::error_code none;
      const std::uintmax_t size = fs::file_size(from_.path(object.hash), none);
      if (!none) bytes += size + kFileOverhead;
    }
    core::require_room(to_.folder(), bytes, "the backup");
  }

  // Returns what is wrong with an object that the backup then has no sound copy of. May be called from several threads.
  std::optional<std::string> run(const OwnedObject& object, BackupReport& report) {
    if (seems_there(object.hash)) return std::nullopt;
    if (const auto problem = from_.problem(object.hash)) {
      if (!to_.problem(object.hash)) return std::nullopt;
      return object.owner + ": object " + object.hash.hex() + " " + *problem;
    }
    const std::uintmax_t size = to_.adopt(from_.path(object.hash), object.hash);
    const std::scoped_lock lock(mutex_);
    ++report.copied;
    report.copied_bytes += size;
    return std::nullopt;
  }

 private:
  // A file of the same size. That its bytes are right `store verify` of the backup says, which reads them.
  bool seems_there(const ContentHash& hash) const {
    if (!from_.exists(hash) || !to_.exists(hash)) return false;
    std::error_code ours, theirs;
    const std::uintmax_t a = fs::file_size(from_.path(hash), ours), b = fs::file_size(to_.path(hash), theirs);
    return !ours && !theirs && a == b;
  }

  const ObjectFiles& from_;
  const ObjectFiles& to_;
  std::mutex mutex_;
};

}  // namespace

BackupReport Store::back_up(const fs::path& folder) const {
  require_apart(folder, this->folder());
  const fs::path catalogue = file_of(impl_->database);
  if (const auto damaged = damaged_pages(catalogue); !damaged.empty()) {
    throw core::StoreError(
        this->folder().string() + ": page " + std::to_string(damaged[0]) +
        " of the catalogue does not match its checksum; nothing was copied. `lightstage store repair` says what to do");
  }
  require_own_folders(folder);
  BackupReport report;
  explaining(folder, [&] {
    core::make_folder(folder / "objects");
    const core::FileLock alone = lock_objects(folder);
    std::optional<Earlier> earlier = Earlier::in(folder, this->folder());
    if (earlier && store_id(earlier->database()) != store_id(impl_->database)) {
      throw core::UsageError(folder.string() + ": there is another store in this folder, not a backup of " +
                             this->folder().string() + "; choose a folder of its own");
    }
    const Snapshot snapshot(impl_->database, folder);
    const std::vector<OwnedObject> objects = [&] {
      SQLite::Database database = snapshot.open();
      return all_objects(database);
    }();
    report.objects = objects.size();
    const ObjectFiles files(folder);
    ObjectCopy copy(impl_->objects, files);
    // Twice the catalogue, for it comes beside the one that it replaces, which may stay.
    copy.require_room(objects, 2 * snapshot.bytes() + (earlier ? earlier->bytes() : 0));
    std::vector<std::optional<std::string>> problems(objects.size());
    core::Progress progress("copying objects", objects.size());
    core::parallel_for(objects.size(), 1, [&](std::size_t first, std::size_t last) {
      for (std::size_t i = first; i < last; ++i) {
        core::throw_if_interrupted();
        problems[i] = copy.run(objects[i], report);
        progress.advance();
      }
    });
    for (std::optional<std::string>& problem : problems) {
      if (problem) report.damaged.push_back(*std::move(problem));
    }
    copy_models(this->folder(), folder, report);
    if (earlier) earlier->keep_unless_contained(snapshot, report);
    snapshot.install();
    sync_folder(folder);
  });
  return report;
}

BackupReport Store::restore(const fs::path& backup, const fs::path& folder) {
  if (has_catalogue(folder)) {
    throw core::UsageError(folder.string() +
                           ": there is a store already; restore into a new folder, or mend this one with `lightstage "
                           "store repair --from " +
                           backup.string() + "`");
  }
  const BackupPlace place(backup);
  if (!place.kept && !has_catalogue(backup)) {
    throw core::StoreError(backup.string() +
                           ": there is no backup here (no store.sqlite in it); name the folder that `lightstage store "
                           "backup` was given");
  }
  BackupCatalogue catalogue(place);  // until the copy is made
  const Store source(std::unique_ptr<Impl>(
      new Impl{place.folder, ObjectFiles(place.folder), std::move(catalogue).take(), StorePlace(place.folder)}));
  require_apart(folder, place.folder);
  // Once there is a catalogue that does not know them, `store gc` would remove them.
  std::size_t unknown = 0;
  std::error_code none;
  if (fs::is_directory(folder / "objects", none)) {
    for (const ContentHash& hash : ObjectFiles(folder).list().objects) {
      unknown += is_referred_to(source.impl_->database, hash) ? 0 : 1;
    }
  }
  if (unknown > 0) {
    throw core::UsageError(
        folder.string() + ": " + std::to_string(unknown) + " objects here are not of " + backup.string() +
        "; restore into a new folder, or, if this is the store whose catalogue is lost, mend it with "
        "`lightstage store repair --from " +
        backup.string() + "`");
  }
  return source.back_up(folder);
}

}  // namespace lightstage::db
