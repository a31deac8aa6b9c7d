#include "db/store/catalogue.h"

#include <sys/statvfs.h>

#include <array>
#include <cctype>
#include <cstdint>
#include <cstring>
#include <fstream>
#include <optional>
#include <string>

#include <sqlite3.h>

#include "core/big_endian.h"
#include "core/file.h"
#include "core/file_lock.h"
#include "core/scratch_folder.h"
#include "db/store/bare_file.h"
#include "db/store/foreign_catalogue.h"
#include "db/store/lock_holders.h"
#include "db/store/log_damage.h"
#include "db/store/migrations.h"
#include "db/store/object_files.h"
#include "db/store/page_checks.h"
#include "db/store/store_folder.h"
#include "db/store/write_ahead_log.h"

namespace lightstage::db {

namespace fs = std::filesystem;

namespace {

bool is_mounted_read_only(const fs::path& folder) {
  struct statvfs status {};
  return ::statvfs(folder.empty() ? "." : folder.c_str(), &status) == 0 && (status.f_flag & ST_RDONLY) != 0;
}

struct Identity {
  int application_id = 0;
  int version = 0;
};

// The first page of the database as its write-ahead log has it; nothing when there is no log. SQLite itself reads the log,
// but on a copy in another folder: opening the original would make a -shm file and, on closing, fold the log into the
// database. Of the database only the first page is copied; the rest is a hole of the right length.
std::optional<Identity> identity_with_log(const fs::path& database) {
  const fs::path log = database.string() + "-wal";
  std::error_code error;
  if (!fs::exists(log, error) || fs::file_size(log, error) == 0 || error) return std::nullopt;
  const core::ScratchFolder scratch(core::temporary_folder());
  const fs::path copy = scratch.path() / "look.sqlite";
  {
    constexpr std::size_t kLargestPage = 65536;
    std::array<unsigned char, kLargestPage> page{};
    const std::size_t size = BareFile(database).read(0, page);
    std::ofstream(copy, std::ios::binary).write(reinterpret_cast<const char*>(page.data()), std::streamsize(size));
  }
  fs::copy_file(log, copy.string() + "-wal", error);
  // Whoever used the store has closed it just now, which leaves everything in the database itself.
  if (error == std::errc::no_such_file_or_directory) return std::nullopt;
  if (!error) fs::resize_file(copy, fs::file_size(database), error);
  if (error) throw core::StoreError(log.string() + ": cannot be copied to look at it: " + error.message());
  SQLite::Database look(copy.string(), SQLite::OPEN_READWRITE);
  return Identity{look.execAndGet("PRAGMA application_id").getInt(), look.execAndGet("PRAGMA user_version").getInt()};
}

// What the file is, without opening it as a database; nothing for a file that is none.
std::optional<Identity> look_at(const fs::path& database) {
  // https://www.sqlite.org/fileformat.html, section 1.3: magic at 0, user version at 60, application id at 68.
  constexpr std::size_t kHeaderSize = 100;
  std::array<unsigned char, kHeaderSize> header{};
  if (BareFile(database).read(0, header) != kHeaderSize || std::memcmp(header.data(), "SQLite format 3", 16) != 0) {
    return std::nullopt;
  }
  if (const auto identity = identity_with_log(database)) return identity;
  return Identity{int(core::big_endian_32(header, 68)), int(core::big_endian_32(header, 60))};
}

void refuse_newer(const fs::path& store_folder, int version) {
  if (version <= schema_version()) return;
  throw core::StoreError(store_folder.string() + ": this store has schema version " + std::to_string(version) +
                         ", this program knows version " + std::to_string(schema_version()) +
                         "; it was not touched. Use the newer lightstage that made it");
}

void configure(SQLite::Database& database, const fs::path& store_folder) {
  database.exec("PRAGMA trusted_schema = OFF");
  database.exec("PRAGMA cell_size_check = ON");
  database.exec("PRAGMA foreign_keys = ON");
  if (is_mounted_read_only(store_folder)) return;  // what follows is about writing
  database.exec("PRAGMA synchronous = FULL");
  if (database.execAndGet("PRAGMA journal_mode = WAL").getString() != "wal") {
    throw core::StoreError(store_folder.string() +
                           ": the file system cannot hold a write-ahead log; keep the store on a local disk");
  }
  bound_log(database);
}

// Whether there are objects, which a catalogue must have known. A folder that cannot be looked into has some.
bool has_objects(const fs::path& store_folder) {
  std::error_code error;
  if (!fs::exists(store_folder / "objects", error) && !error) return false;
  try {
    for (const fs::directory_entry& entry : fs::recursive_directory_iterator(store_folder / "objects")) {
      if (!entry.is_directory()) return true;
    }
    return false;
  } catch (const fs::filesystem_error&) {
    return true;
  }
}

std::string how_to_mend(const fs::path& store_folder) {
  return "; `lightstage store repair --store " + store_folder.string() +
         " --from BACKUP` makes a catalogue for its objects of a backup";
}

// For SQLite's names of files with parameters (https://www.sqlite.org/uri.html, section 3.1).
std::string percent_encoded(const std::string& text) {
  constexpr std::string_view kDigits = "0123456789ABCDEF";
  std::string encoded;
  for (const char c : text) {
    const auto byte = static_cast<unsigned char>(c);
    const bool plain = std::isalnum(byte) != 0 || c == '/' || c == '.' || c == '-' || c == '_';
    encoded += plain ? std::string(1, c) : std::string{'%', kDigits[byte >> 4], kDigits[byte & 15]};
  }
  return encoded;
}

// On a file system that takes no writes SQLite can neither make nor lock the index of the log. It needs none where there is no log (and nobody writes),
// and reads a log whose index its last user left beside it.
SQLite::Database open_for_reading(const fs::path& path) {
  const fs::path log = path.string() + "-wal", index = path.string() + "-shm";
  std::error_code none;
  if (fs::exists(log, none) && fs::exists(index, none)) {
    return open_checked(path, SQLite::OPEN_READONLY, kBusyTimeoutMs);
  }
  if (fs::exists(log, none) && !fs::is_empty(log, none)) {
    throw core::StoreError(log.string() +
                           ": this log holds what was written last, and cannot be read while the file system is "
                           "mounted read-only; mount it for writing once and list the store (`lightstage store ls`), "
                           "or copy the folder to another disk and read it there");
  }
  const std::string name = "file:" + percent_encoded(fs::absolute(path).string()) + "?immutable=1";
  return open_checked(name, SQLite::OPEN_READONLY | SQLite::OPEN_URI);
}

bool lacks_room_for_index(const SQLite::Exception& error) {
  return error.getExtendedErrorCode() == SQLITE_IOERR_SHMSIZE || error.getExtendedErrorCode() == SQLITE_IOERR_SHMMAP;
}

SQLite::Database connect(const fs::path& path) {
  if (is_mounted_read_only(path.parent_path())) return open_for_reading(path);
  const auto look = [](SQLite::Database& database) { database.execAndGet("PRAGMA user_version"); };
  try {
    SQLite::Database database = open_checked(path, SQLite::OPEN_READWRITE, kBusyTimeoutMs);
    look(database);
    return database;
  } catch (const SQLite::Exception& error) {
    if (!lacks_room_for_index(error)) throw;
    // The disk is full: who has the store alone can keep the index in memory.
    try {
      SQLite::Database alone = open_checked(path, SQLite::OPEN_READWRITE);
      alone.exec("PRAGMA locking_mode = EXCLUSIVE");
      look(alone);
      return alone;
    } catch (const SQLite::Exception&) {  // somebody else reads
    }
    throw;
  }
}

}  // namespace

fs::path catalogue_path(const fs::path& store_folder) {
  return store_folder / "store.sqlite";
}

bool has_catalogue(const fs::path& store_folder) {
  std::error_code none;
  return fs::exists(catalogue_path(store_folder), none) && !fs::is_empty(catalogue_path(store_folder), none);
}

fs::path numbered(const fs::path& file, const char* suffix) {
  std::error_code none;
  for (int i = 1;; ++i) {
    fs::path place = file.string() + suffix + std::to_string(i);
    if (!fs::exists(place, none)) return place;
  }
}

SQLite::Database create_catalogue(const fs::path& store_folder) {
  return explaining(store_folder, [&] {
    const fs::path path = catalogue_path(store_folder);
    // Of two that create at once, the second finds a store.
    const core::FileLock alone(store_folder);
    if (has_catalogue(store_folder)) {
      throw core::UsageError(store_folder.string() + ": there is a store already");
    }
    // An empty catalogue would know none of them, and `store gc` would remove them.
    if (has_objects(store_folder)) {
      throw core::UsageError(store_folder.string() + ": there are objects of a store here, whose catalogue is lost" +
                             how_to_mend(store_folder) + ". A new store goes to another folder");
    }
    {
      // Made elsewhere and moved in whole, so that a crash leaves a store or none.
      const core::ScratchFolder scratch(store_folder);
      const fs::path made = scratch.path() / path.filename();
      {
        SQLite::Database database = open_checked(made, SQLite::OPEN_READWRITE | SQLite::OPEN_CREATE);
        migrate(database);
        configure(database, store_folder);
      }
      put_catalogue(made, store_folder);
    }
    SQLite::Database database = open_checked(path, SQLite::OPEN_READWRITE, kBusyTimeoutMs);
    configure(database, store_folder);
    return database;
  });
}

SQLite::Database open_catalogue(const fs::path& store_folder) {
  require_own_folders(store_folder);
  const fs::path path = catalogue_path(store_folder);
  std::error_code none;
  if (!fs::exists(path, none)) {
    if (has_objects(store_folder)) {
      throw core::StoreError(store_folder.string() + ": the catalogue store.sqlite is missing" +
                             how_to_mend(store_folder));
    }
    throw core::StoreError(store_folder.string() +
                           ": there is no store here (no store.sqlite); make one with `lightstage init --store " +
                           store_folder.string() + "`");
  }
  return explaining(store_folder, [&] {
    if (fs::is_symlink(path, none)) {
      throw core::StoreError(path.string() +
                             ": is a symbolic link; a store's catalogue lies in the store's own folder");
    }
    if (fs::is_regular_file(path, none) && fs::is_empty(path, none) && has_objects(store_folder)) {
      throw core::StoreError(store_folder.string() + ": the catalogue store.sqlite is empty" +
                             how_to_mend(store_folder));
    }
    const std::optional<Identity> identity = fs::is_regular_file(path, none) ? look_at(path) : std::nullopt;
    if (!identity || identity->application_id != kApplicationId) {
      throw core::StoreError(path.string() + ": this file is not a Lightstage store");
    }
    refuse_newer(store_folder, identity->version);
    refuse_damaged_log(store_folder);
    SQLite::Database database = connect(path);
    // Once more: another program may have migrated it since the look.
    const int version = database.execAndGet("PRAGMA user_version").getInt();
    refuse_newer(store_folder, version);
    distrust(database);
    require_own_schema(database, store_folder);
    configure(database, store_folder);
    if (version < schema_version() && is_mounted_read_only(store_folder)) {
      throw core::StoreError(store_folder.string() + ": this store has the older schema version " +
                             std::to_string(version) +
                             ", which cannot be brought up to date while its file system is mounted read-only; mount "
                             "it for writing once, or copy the folder to another disk");
    }
    if (version < schema_version()) {
      if (!has_page_checks(database)) renew_page_checks(database);
      migrate(database);
    }
    return database;
  });
}

void put_catalogue(const fs::path& made, const fs::path& store_folder) {
  const fs::path path = catalogue_path(store_folder);
  std::error_code none;
  if (fs::exists(path.string() + "-wal", none)) {
    throw core::StoreError(path.string() +
                           "-wal: this log of a catalogue that is gone is in the way; move it to another folder");
  }
  core::move_file_durably(made, path);
}

void throw_if_newer(const fs::path& store_folder) {
  const std::optional<Identity> identity = look_at(catalogue_path(store_folder));
  if (identity && identity->application_id == kApplicationId) refuse_newer(store_folder, identity->version);
}

core::StoreError explained(const SQLite::Exception& error, const fs::path& store_folder) {
  std::string text = store_folder.string() + ": ";
  switch (error.getErrorCode()) {
    case SQLITE_BUSY:
    case SQLITE_LOCKED: {
      const std::string holders = lock_holders(store_folder);
      text += (holders.empty() ? "another program" : holders) +
              " has been writing to this store for too long; try again when it is done";
      break;
    }
    case SQLITE_FULL:
      text += "the disk is full; nothing of this step was stored";
      break;
    case SQLITE_READONLY:
    case SQLITE_CANTOPEN:
    case SQLITE_PERM:
      text += is_mounted_read_only(store_folder)
                  ? "its file system is mounted read-only: what is here can be read, and nothing be changed"
                  : "the store cannot be opened for writing; check who owns the folder and its permissions";
      break;
    case SQLITE_CORRUPT:
    case SQLITE_NOTADB:
      text += "the catalogue store.sqlite is damaged; `lightstage store verify` says more";
      break;
    default:
      text += lacks_room_for_index(error)
                  ? "the disk is full, and while others use the store even reading takes some room; remove something "
                    "else from that disk"
                  : "database error";
  }
  return core::StoreError(text + " (" + error.what() + ")");
}

}  // namespace lightstage::db
