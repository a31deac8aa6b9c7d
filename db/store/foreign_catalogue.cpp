#include "db/store/foreign_catalogue.h"

#include <sqlite3.h>

#include <SQLiteCpp/Statement.h>
#include <SQLiteCpp/Transaction.h>
#include <cstdint>
#include <string>

#include "core/error.h"
#include "core/printable.h"
#include "db/store/migrations.h"

namespace lightstage::db {

namespace {

constexpr int kLongestValue = 64 << 20;            // bytes
constexpr std::int64_t kQuicklyChecked = 4 << 20;  // bytes
constexpr int kOff = 0, kOn = 1;

// The first thing in the schema that is neither table nor index: whoever finds it, knows at once that it is not ours.
std::string first_stranger(SQLite::Database& database) {
  SQLite::Statement row(database, "SELECT type, name FROM sqlite_schema WHERE type NOT IN ('table', 'index') LIMIT 1");
  if (!row.executeStep()) return {};
  return row.getColumn(0).getString() + " " + core::quoted(row.getColumn(1).getString());
}

}  // namespace

void distrust(SQLite::Database& database) {
  sqlite3* const handle = database.getHandle();
  for (const int off : {SQLITE_DBCONFIG_TRUSTED_SCHEMA, SQLITE_DBCONFIG_ENABLE_TRIGGER, SQLITE_DBCONFIG_ENABLE_VIEW,
                        SQLITE_DBCONFIG_ENABLE_LOAD_EXTENSION, SQLITE_DBCONFIG_DQS_DDL, SQLITE_DBCONFIG_DQS_DML}) {
    sqlite3_db_config(handle, off, kOff, nullptr);
  }
  sqlite3_db_config(handle, SQLITE_DBCONFIG_DEFENSIVE, kOn, nullptr);
  sqlite3_limit(handle, SQLITE_LIMIT_LENGTH, kLongestValue);
}

void require_own_schema(SQLite::Database& database, const std::filesystem::path& store_folder) {
  const SQLite::Transaction snapshot(database);  // another program may be migrating it
  const int version = database.execAndGet("PRAGMA user_version").getInt();
  SQLite::Database own(":memory:", SQLite::OPEN_READWRITE | SQLite::OPEN_CREATE);
  migrate(own, version);
  if (schema_of(database) != schema_of(own)) {
    const std::string stranger = first_stranger(database);
    throw core::StoreError(store_folder.string() + ": its catalogue was changed by another program: " +
                           (stranger.empty() ? "its tables are not those of schema version " + std::to_string(version)
                                             : "it holds a " + stranger) +
                           "; it was not read any further");
  }
}

std::optional<std::string> quick_finding(SQLite::Database& database) {
  const std::int64_t bytes =
      database.execAndGet("PRAGMA page_count").getInt64() * database.execAndGet("PRAGMA page_size").getInt64();
  if (bytes > kQuicklyChecked) return std::nullopt;
  const std::string found = database.execAndGet("PRAGMA quick_check(1)").getString();
  return found == "ok" ? std::nullopt : std::optional(found);
}

}  // namespace lightstage::db
