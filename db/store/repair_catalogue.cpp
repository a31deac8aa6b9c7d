// Store: a new catalogue of what can be read of a damaged one and of backups.
#include <algorithm>
#include <optional>

#include <sqlite3.h>

#include "core/error.h"
#include "core/interrupt.h"
#include "core/scratch_folder.h"
#include "db/store/impl.h"
#include "db/store/log_damage.h"
#include "db/store/migrations.h"
#include "db/store/page_checks.h"

namespace lightstage::db {

namespace fs = std::filesystem;

namespace {

// In an order in which nothing refers to a later one.
constexpr const char* kTables[] = {"identity",
                                   "objects",
                                   "scans",
                                   "cameras",
                                   "steps",
                                   "frames",
                                   "products",
                                   "product_input_scans",
                                   "product_input_products",
                                   "product_images",
                                   "calibrated_lights"};

bool is_sound(SQLite::Database& database) {
  SQLite::Statement check(database, "PRAGMA integrity_check(1)");
  return check.executeStep() && check.getColumn(0).getString() == "ok";
}

enum class Condition {
  kSound,
  kWritten,  // whole, but with pages that do not match their checksums
  kDamaged   // missing, no catalogue, or damaged in its structure
};

Condition condition_of(const fs::path& store_folder) {
  const fs::path path = catalogue_path(store_folder);
  std::error_code none;
  if (!fs::exists(path, none)) return Condition::kDamaged;
  const std::vector<std::size_t> damaged = damaged_pages(path);
  if (!damaged.empty() && one_bit_flipped(path, damaged)) return Condition::kDamaged;
  try {
    SQLite::Database database = open_catalogue(store_folder);
    if (!is_sound(database)) return Condition::kDamaged;
    return damaged.empty() ? Condition::kSound : Condition::kWritten;
  } catch (const core::StoreError&) {
    throw_if_newer(store_folder);
    return Condition::kDamaged;
  } catch (const SQLite::Exception&) {
    return Condition::kDamaged;
  }
}

std::string columns_of(SQLite::Database& database, const std::string& table) {
  std::string names;
  SQLite::Statement row(database, "SELECT name FROM pragma_table_info(?)");
  row.bind(1, table);
  while (row.executeStep()) names += ", " + row.getColumn(0).getString();
  return names;
}

// Copies rows from one catalogue to another, in place of what has the same keys there.
class RowCopy {
 public:
  RowCopy(SQLite::Database& from, SQLite::Database& to, const std::string& table)
      : read_(from, "SELECT rowid" + columns_of(to, table) + " FROM " + table + " WHERE rowid >= ? ORDER BY rowid"),
        write_(to, insertion(to, table)) {}

  // Rows on pages that cannot be read are stepped over.
  void run(std::size_t& copied) {
    Id next = 0;
    while (const std::optional<Id> stuck = run_from(next, copied)) {
      const std::optional<Id> beyond = first_readable_after(*stuck);
      if (!beyond) return;
      next = *beyond;
    }
  }

 private:
  static std::string insertion(SQLite::Database& to, const std::string& table) {
    const std::string columns = columns_of(to, table);
    std::string places;
    for (std::size_t i = std::size_t(std::count(columns.begin(), columns.end(), ',')); i > 0; --i) places += ", ?";
    return "INSERT OR REPLACE INTO " + table + " (rowid" + columns + ") VALUES (?" + places + ")";
  }

  // The key at which a page could not be read; nothing when all is done.
  std::optional<Id> run_from(Id first, std::size_t& copied) {
    Id next = first;
    try {
      read_.reset();
      read_.bind(1, std::int64_t(first));
      while (read_.executeStep()) {
        core::throw_if_interrupted();
        next = read_.getColumn(0).getInt64() + 1;
        if (write_row()) ++copied;
      }
      return std::nullopt;
    } catch (const SQLite::Exception&) {
      return next;
    }
  }

  // False for a row that breaks the table's rules.
  bool write_row() {
    write_.reset();
    for (int i = 0; i < read_.getColumnCount(); ++i) {
      const SQLite::Column value = read_.getColumn(i);
      if (value.isInteger()) {
        write_.bind(i + 1, value.getInt64());
      } else if (value.isFloat()) {
        write_.bind(i + 1, value.getDouble());
      } else if (value.isText()) {
        write_.bind(i + 1, value.getString());
      } else {  // no table of ours holds blobs
        write_.bind(i + 1);
      }
    }
    return write_.tryExecuteStep() == SQLITE_DONE;
  }

  bool readable(Id first) {
    try {
      read_.reset();
      read_.bind(1, std::int64_t(first));
      read_.executeStep();
      return true;
    } catch (const SQLite::Exception&) {
      return false;
    }
  }

  // By steps that double, then halve: a page holds up to some hundred rows.
  std::optional<Id> first_readable_after(Id stuck) {
    constexpr Id kFarthest = Id(1) << 40;
    Id step = 1;
    while (!readable(stuck + step)) {
      step *= 2;
      if (step > kFarthest) return std::nullopt;
    }
    Id unreadable = step / 2;
    while (step - unreadable > 1) {
      const Id middle = unreadable + (step - unreadable) / 2;
      (readable(stuck + middle) ? step : unreadable) = middle;
    }
    return stuck + step;
  }

  SQLite::Statement read_, write_;
};

std::size_t copy_rows(SQLite::Database& from, SQLite::Database& to) {
  std::size_t copied = 0;
  for (const char* table : kTables) {
    try {
      RowCopy(from, to, table).run(copied);
    } catch (const SQLite::Exception&) {  // the table is not there, or where its rows are cannot be read
    }
  }
  return copied;
}

// Rows that refer to what could not be read.
std::size_t drop_dangling(SQLite::Database& database) {
  std::size_t dropped = 0;
  for (;;) {
    std::vector<std::pair<std::string, Id>> dangling;
    {
      SQLite::Statement row(database, "PRAGMA foreign_key_check");
      while (row.executeStep()) dangling.emplace_back(row.getColumn(0).getString(), row.getColumn(1).getInt64());
    }
    if (dangling.empty()) return dropped;
    for (const auto& [table, rowid] : dangling) {
      SQLite::Statement removal(database, "DELETE FROM " + table + " WHERE rowid = ?");
      removal.bind(1, std::int64_t(rowid));
      dropped += std::size_t(removal.exec());
    }
  }
}

std::optional<std::string> store_id(SQLite::Database& database) {
  try {
    return database.execAndGet("SELECT store_id FROM identity").getString();
  } catch (const SQLite::Exception&) {
    return std::nullopt;
  }
}

// The sound pages of the catalogue, and nobody else at it.
std::optional<SQLite::Database> open_alone(const fs::path& path, const fs::path& store_folder) {
  std::optional<SQLite::Database> database = open_mended_pages(path);
  if (!database) return std::nullopt;
  try {
    database->exec("PRAGMA locking_mode = EXCLUSIVE; BEGIN IMMEDIATE; COMMIT");
  } catch (const SQLite::Exception& error) {
    if (error.getErrorCode() == SQLITE_BUSY || error.getErrorCode() == SQLITE_LOCKED) {
      throw core::StoreError(store_folder.string() +
                             ": the catalogue is damaged, and another program has it open; end that, then repair");
    }
  }
  return database;
}

// A name for the damaged catalogue that is not taken.
fs::path place_for_damaged(const fs::path& path) {
  std::error_code none;
  for (int i = 1;; ++i) {
    fs::path place = path.string() + kDamagedSuffix + std::to_string(i);
    if (!fs::exists(place, none)) return place;
  }
}

void move_away(const fs::path& path, const fs::path& damaged) {
  std::error_code error;
  // A second name first, so that there is a catalogue, damaged or new, at every moment.
  if (fs::exists(path, error)) fs::create_hard_link(path, damaged, error);
  if (error) throw core::StoreError(damaged.string() + ": cannot be made: " + error.message());
  // A log beside the new catalogue would be taken for its own.
  if (fs::exists(path.string() + "-wal", error)) fs::rename(path.string() + "-wal", damaged.string() + "-wal", error);
  if (error) throw core::StoreError(path.string() + "-wal: cannot be moved: " + error.message());
  fs::remove(path.string() + "-shm", error);
}

}  // namespace

CatalogueRepair Store::repair_catalogue(const fs::path& folder, const std::vector<fs::path>& backups, bool accept) {
  require_own_folders(folder);
  std::error_code none;
  if (!fs::is_directory(folder / "objects", none)) {
    throw core::StoreError(folder.string() + ": there is no store here (no folder objects)");
  }
  CatalogueRepair report;
  const LogRepair log = repair_log(folder);  // before anybody opens the catalogue, and with it the log
  report.log_copy = log.damaged_copy;
  report.log_bits = log.bits;
  report.log_pages_lost = log.pages_lost;
  const Condition condition = condition_of(folder);
  if (condition == Condition::kSound) return report;
  const fs::path path = catalogue_path(folder);
  if (condition == Condition::kWritten && accept) {
    explaining(folder, [&] {
      SQLite::Database database = open_catalogue(folder);
      renew_page_checks(database);
      database.exec("PRAGMA wal_checkpoint(TRUNCATE)");
    });
    report.accepted = true;
    return report;
  }
  if (condition == Condition::kWritten && backups.empty()) {
    throw core::StoreError(
        folder.string() +
        ": pages of the catalogue do not match their checksums, yet it is whole. If another program has written to "
        "store.sqlite, or opened it after a crash, --accept-catalogue takes it as it is; if not, name a backup with "
        "--from");
  }
  explaining(folder, [&] {
    const core::ScratchFolder scratch(folder);
    const fs::path made = scratch.path() / path.filename();
    {
      std::optional<SQLite::Database> damaged = open_alone(path, folder);
      const std::optional<std::string> id = damaged ? store_id(*damaged) : std::nullopt;
      SQLite::Database fresh = open_checked(made, SQLite::OPEN_READWRITE | SQLite::OPEN_CREATE);
      migrate(fresh);
      fresh.exec("PRAGMA foreign_keys = OFF; BEGIN");
      for (const fs::path& backup : backups) {
        SQLite::Database sound = open_catalogue(backup);
        if (id && store_id(sound) != id) {
          throw core::UsageError(backup.string() + ": this is a backup of another store than " + folder.string());
        }
        report.rows_from_backups += copy_rows(sound, fresh);
      }
      if (damaged) report.rows_read = copy_rows(*damaged, fresh);
      if (report.rows_read + report.rows_from_backups == 0) {
        throw core::StoreError(
            folder.string() + ": nothing of the catalogue can be read; name a backup with --from. Nothing was changed");
      }
      report.rows_dropped = drop_dangling(fresh);
      fresh.exec("COMMIT");
    }
    report.damaged_copy = place_for_damaged(path);
    move_away(path, report.damaged_copy);
    put_catalogue(made, folder);
  });
  return report;
}

}  // namespace lightstage::db
