// Store: a new catalogue of what can be read of a damaged one and of backups.
#include <algorithm>
#include <list>
#include <optional>
#include <set>

#include <sqlite3.h>

#include "core/error.h"
#include "core/file.h"
#include "core/scratch_folder.h"
#include "core/text.h"
#include "db/store/backup_place.h"
#include "db/store/catalogue_rows.h"
#include "db/store/impl.h"
#include "db/store/log_damage.h"
#include "db/store/migrations.h"
#include "db/store/page_checks.h"

namespace lightstage::db {

namespace fs = std::filesystem;

namespace {

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

// Objects' rows say only what their files know too.
void enter_objects_again(SQLite::Database& database, const ObjectFiles& files) {
  SQLite::Statement unknown(database,
                            "SELECT object FROM frames UNION SELECT object FROM product_images EXCEPT SELECT hash FROM "
                            "objects");
  std::vector<ContentHash> hashes;
  while (unknown.executeStep()) hashes.push_back(ContentHash::from_hex(unknown.getColumn(0).getString()));
  for (const ContentHash& hash : hashes) {
    try {
      const core::ImageSize size = files.read_size(hash);
      SQLite::Statement row(database, "INSERT INTO objects (hash, height, width, channels) VALUES (?, ?, ?, ?)");
      bind_all(row, hash, size.height, size.width, size.channels);
      row.exec();
    } catch (const core::StoreError&) {  // the file is damaged or gone too
    }
  }
}

// Catalogues to take rows from, the newest first.
class Sources {
 public:
  explicit Sources(const std::vector<fs::path>& backups) {
    for (const fs::path& backup : backups) {
      Source& source = sources_.emplace_front(backup);
      const std::string id = store_id(source.catalogue.database());
      if (id.empty()) throw core::StoreError(backup.string() + ": its catalogue does not say which store it is of");
      if (!id_.empty() && id != id_) {
        throw core::UsageError(backup.string() + ": this is a backup of another store than " +
                               sources_.back().named.string());
      }
      id_ = id;
    }
  }

  // Throws UsageError unless they are of the store in this folder: as its identity says or, where that is lost, the objects.
  void require_of(const fs::path& folder, const std::string& own_id) {
    if (sources_.empty()) return;
    if (!own_id.empty() && own_id != id_) {
      throw core::UsageError(sources_.back().named.string() + ": this is a backup of another store than " +
                             folder.string());
    }
    if (!own_id.empty()) return;
    const ObjectFiles files(folder);
    std::vector<ObjectsHere> counts;
    for (Source& source : sources_) {
      counts.push_back(objects_here(source.catalogue.database(), files));
      if (2 * counts.back().here > counts.back().all) return;
    }
    if (counts.front().all == 0 && files.list().objects.empty()) return;
    const std::string newest = sources_.front().named.string();
    throw core::UsageError(newest + ": of the " + std::to_string(counts.front().all) + " objects of this backup " +
                           std::to_string(counts.front().here) + " are in " + folder.string() +
                           ", whose own catalogue cannot say which store it is: it seems to be another. `lightstage "
                           "store restore " +
                           newest + "` makes a store of the backup in a folder of its own");
  }

  // Of a catalogue whose own identity is lost.
  void identify(SQLite::Database& catalogue) const {
    if (sources_.empty()) return;
    SQLite::Statement row(catalogue, "INSERT OR REPLACE INTO identity (only, store_id) VALUES (1, ?)");
    row.bind(1, id_);
    row.exec();
  }

  void add_to(SQLite::Database& catalogue, CatalogueRepair& report) {
    for (Source& source : sources_) {
      AddedRows added = [&] {
        const fs::path file = file_of(source.catalogue.database());
        if (damaged_pages(file).empty()) return add_missing_rows(source.catalogue.database(), catalogue);
        std::optional<SQLite::Database> sound = open_sound_pages(file);
        return sound ? add_missing_rows(*sound, catalogue) : AddedRows();
      }();
      report.rows_from_backups += added.count;
      for (const std::string& clash : added.clashes) {
        report.clashes.push_back(clash + ", of " + source.named.string());
      }
    }
  }

 private:
  struct Source {
    explicit Source(const fs::path& name) : named(name), catalogue(BackupPlace(name)) {}
    fs::path named;
    BackupCatalogue catalogue;
  };
  std::list<Source> sources_;
  std::string id_;
};

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

void move_away(const fs::path& folder, const fs::path& damaged) {
  const fs::path path = catalogue_path(folder);
  std::error_code error;
  // A second name first, so that there is a catalogue, damaged or new, at every moment.
  if (has_catalogue(folder)) fs::create_hard_link(path, damaged, error);
  if (error) throw core::StoreError(damaged.string() + ": cannot be made: " + error.message());
  // A log beside the new catalogue would be taken for its own.
  if (fs::exists(path.string() + "-wal", error)) fs::rename(path.string() + "-wal", damaged.string() + "-wal", error);
  if (error) throw core::StoreError(path.string() + "-wal: cannot be moved: " + error.message());
  fs::remove(path.string() + "-shm", error);
}

// The damaged catalogues that repairs have put aside, with what can be read of each.
template <class Use>
void each_damaged(const fs::path& folder, const Use& use) {
  const std::string name = catalogue_path({}).string() + kDamagedSuffix;
  for (const auto& entry : fs::directory_iterator(folder)) {
    const std::string file = entry.path().filename().string();
    if (!file.starts_with(name) || !core::parse_integer(std::string_view(file).substr(name.size()))) continue;
    // Opened as they are they would change.
    const core::ScratchFolder scratch(core::temporary_folder());
    const fs::path copy = catalogue_path(scratch.path());
    std::error_code none;
    fs::copy_file(entry.path(), copy, none);
    fs::copy_file(entry.path().string() + "-wal", copy.string() + "-wal", none);
    std::optional<SQLite::Database> pages = open_mended_pages(copy);
    use(pages);
  }
}

// A sound catalogue gets what was lost earlier, or removed, and stands in backups.
void add_to_sound(const fs::path& folder, const std::vector<fs::path>& backups, CatalogueRepair& report) {
  const bool lost_some = holds_garbage(folder).has_value();
  const bool asked_for = std::any_of(backups.begin(), backups.end(),
                                     [](const fs::path& backup) { return BackupPlace(backup).kept.has_value(); });
  if (!lost_some && !asked_for) return;
  SQLite::Database own = open_catalogue(folder);
  if (!backups.empty()) {
    Sources sources(backups);
    // A repair that could not read which store it was has made up a new identity.
    std::string own_id = store_id(own);
    each_damaged(folder, [&](std::optional<SQLite::Database>& damaged) {
      if (!damaged || store_id(*damaged).empty()) own_id.clear();
    });
    sources.require_of(folder, own_id);
    SQLite::Transaction whole(own, SQLite::TransactionBehavior::IMMEDIATE);
    if (own_id.empty()) sources.identify(own);
    sources.add_to(own, report);
    whole.commit();
  }
  std::set<std::string> lost;
  each_damaged(folder, [&](std::optional<SQLite::Database>& damaged) {
    if (!damaged) return;
    for (std::string& line : missing_keys(*damaged, own)) lost.insert(std::move(line));
  });
  report.lost.assign(lost.begin(), lost.end());
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
  if (condition == Condition::kSound) {
    explaining(folder, [&] { add_to_sound(folder, backups, report); });
    return report;
  }
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
      Sources sources(backups);
      const std::string own_id = damaged ? store_id(*damaged) : std::string();
      sources.require_of(folder, own_id);
      SQLite::Database fresh = open_checked(made, SQLite::OPEN_READWRITE | SQLite::OPEN_CREATE);
      migrate(fresh);
      fresh.exec("PRAGMA foreign_keys = OFF; BEGIN");
      if (damaged) report.rows_read = copy_readable_rows(*damaged, fresh);
      if (own_id.empty()) sources.identify(fresh);
      sources.add_to(fresh, report);
      if (report.rows_read + report.rows_from_backups == 0) {
        throw core::StoreError(
            folder.string() + ": nothing of the catalogue can be read; name a backup with --from. Nothing was changed");
      }
      enter_objects_again(fresh, ObjectFiles(folder));
      report.rows_dropped = drop_dangling(fresh);
      fresh.exec("COMMIT");
      if (damaged) report.lost = missing_keys(*damaged, fresh);
      std::sort(report.lost.begin(), report.lost.end());
    }
    report.made_anew = true;
    const fs::path aside = numbered(path, kDamagedSuffix);
    if (has_catalogue(folder)) {
      report.damaged_copy = aside;
    } else {
      core::write_file_atomically(numbered(path, kMissingSuffix),
                                  "There was no catalogue here when `lightstage store repair` made one of backups. "
                                  "While this file is here, `store gc` removes nothing.\n");
    }
    move_away(folder, aside);
    put_catalogue(made, folder);
  });
  return report;
}

}  // namespace lightstage::db
