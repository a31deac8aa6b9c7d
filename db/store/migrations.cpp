#include "db/store/migrations.h"

#include <array>

#include <SQLiteCpp/Statement.h>
#include <SQLiteCpp/Transaction.h>

namespace lightstage::db {
namespace {

// That JSON is JSON is checked before it comes here: with an untrusted schema SQLite does not run
// json_valid(). Keys are never used twice (AUTOINCREMENT), so that a key noted elsewhere cannot come to mean
// another thing.
constexpr const char* kVersion1 = R"sql(
CREATE TABLE objects (
  hash TEXT PRIMARY KEY CHECK (length(hash) = 32),
  height INTEGER NOT NULL CHECK (height > 0),
  width INTEGER NOT NULL CHECK (width > 0),
  channels INTEGER NOT NULL CHECK (channels BETWEEN 1 AND 4)
) STRICT;

CREATE TABLE scans (
  id INTEGER PRIMARY KEY AUTOINCREMENT,
  name TEXT NOT NULL UNIQUE,
  kind TEXT NOT NULL CHECK (kind IN ('olat', 'mirror_ball', 'grey_ball', 'chessboard', 'imported', 'virtual')),
  stage_key TEXT NOT NULL,
  provenance TEXT NOT NULL CHECK (provenance <> ''),
  created_utc TEXT NOT NULL,
  program_version TEXT NOT NULL
) STRICT;

CREATE TABLE cameras (
  scan_id INTEGER NOT NULL REFERENCES scans (id) ON DELETE CASCADE,
  position INTEGER NOT NULL,
  name TEXT NOT NULL,
  PRIMARY KEY (scan_id, name),
  UNIQUE (scan_id, position)
) STRICT;

CREATE TABLE steps (
  scan_id INTEGER NOT NULL REFERENCES scans (id) ON DELETE CASCADE,
  step_index INTEGER NOT NULL CHECK (step_index >= 0),
  kind TEXT NOT NULL CHECK (kind IN ('light', 'tracking', 'full_on', 'dark', 'pattern')),
  light_index INTEGER CHECK (light_index >= 0),
  exposure_ns INTEGER NOT NULL CHECK (exposure_ns >= 0),
  pattern TEXT NOT NULL,
  PRIMARY KEY (scan_id, step_index),
  CHECK ((kind = 'light') = (light_index IS NOT NULL)),
  CHECK ((kind = 'pattern') = (pattern <> ''))
) STRICT;

CREATE TABLE frames (
  id INTEGER PRIMARY KEY AUTOINCREMENT,
  scan_id INTEGER NOT NULL,
  camera TEXT NOT NULL,
  step_index INTEGER NOT NULL,
  timestamp_ns INTEGER NOT NULL,
  sequence_number INTEGER NOT NULL,
  attempt INTEGER NOT NULL CHECK (attempt >= 1),
  saturation REAL NOT NULL CHECK (saturation >= 0),
  object TEXT NOT NULL REFERENCES objects (hash),
  UNIQUE (scan_id, camera, step_index),
  FOREIGN KEY (scan_id, camera) REFERENCES cameras (scan_id, name) ON DELETE CASCADE,
  FOREIGN KEY (scan_id, step_index) REFERENCES steps (scan_id, step_index) ON DELETE CASCADE
) STRICT;
CREATE INDEX frames_by_object ON frames (object);

CREATE TABLE products (
  id INTEGER PRIMARY KEY AUTOINCREMENT,
  kind TEXT NOT NULL CHECK (kind <> ''),
  name TEXT NOT NULL,
  scan_id INTEGER REFERENCES scans (id) ON DELETE CASCADE,
  stage_key TEXT NOT NULL,
  parameters TEXT NOT NULL CHECK (parameters <> ''),
  created_utc TEXT NOT NULL,
  program_version TEXT NOT NULL
) STRICT;
CREATE UNIQUE INDEX products_by_name ON products (kind, name) WHERE name <> '';
CREATE INDEX products_by_scan ON products (scan_id);

CREATE TABLE product_input_scans (
  product_id INTEGER NOT NULL REFERENCES products (id) ON DELETE CASCADE,
  position INTEGER NOT NULL,
  scan_id INTEGER NOT NULL REFERENCES scans (id),
  PRIMARY KEY (product_id, position)
) STRICT;
CREATE INDEX product_input_scans_by_scan ON product_input_scans (scan_id);

CREATE TABLE product_input_products (
  product_id INTEGER NOT NULL REFERENCES products (id) ON DELETE CASCADE,
  position INTEGER NOT NULL,
  input_id INTEGER NOT NULL REFERENCES products (id),
  PRIMARY KEY (product_id, position)
) STRICT;
CREATE INDEX product_input_products_by_input ON product_input_products (input_id);

CREATE TABLE product_images (
  product_id INTEGER NOT NULL REFERENCES products (id) ON DELETE CASCADE,
  role TEXT NOT NULL,
  image_index INTEGER NOT NULL,
  object TEXT NOT NULL REFERENCES objects (hash),
  value REAL NOT NULL,
  PRIMARY KEY (product_id, role, image_index)
) STRICT;
CREATE INDEX product_images_by_object ON product_images (object);

CREATE TABLE calibrated_lights (
  product_id INTEGER NOT NULL REFERENCES products (id) ON DELETE CASCADE,
  light_index INTEGER NOT NULL CHECK (light_index >= 0),
  placed INTEGER NOT NULL CHECK (placed IN (0, 1)),
  direction_x REAL NOT NULL,
  direction_y REAL NOT NULL,
  direction_z REAL NOT NULL,
  position_x REAL,
  position_y REAL,
  position_z REAL,
  gain_r REAL NOT NULL,
  gain_g REAL NOT NULL,
  gain_b REAL NOT NULL,
  sigma_degrees REAL NOT NULL CHECK (sigma_degrees >= 0),
  reason TEXT NOT NULL,
  PRIMARY KEY (product_id, light_index)
) STRICT;
)sql";

// Which store this is, whatever folder it lies in: a backup knows whose it is.
constexpr const char* kVersion2 = R"sql(
CREATE TABLE identity (
  only INTEGER PRIMARY KEY CHECK (only = 1),
  store_id TEXT NOT NULL CHECK (length(store_id) = 32)
) STRICT;
INSERT INTO identity (only, store_id) VALUES (1, lower(hex(randomblob(16))));
)sql";

// kMigrations[v] leads from version v to v + 1. What has been released is never edited, only added to.
constexpr std::array kMigrations{kVersion1, kVersion2};

}  // namespace

int schema_version() {
  return int(kMigrations.size());
}

bool migrate(SQLite::Database& database, int to) {
  // Immediate: of two programs that open an old store at once, one waits here and then finds nothing to do.
  SQLite::Transaction transaction(database, SQLite::TransactionBehavior::IMMEDIATE);
  const int found = database.execAndGet("PRAGMA user_version").getInt();
  for (int version = found; version < to; ++version) database.exec(kMigrations[std::size_t(version)]);
  if (found < to) {
    database.exec("PRAGMA application_id = " + std::to_string(kApplicationId));
    database.exec("PRAGMA user_version = " + std::to_string(to));
  }
  transaction.commit();
  return found < to;
}

std::string current_schema() {
  SQLite::Database made(":memory:", SQLite::OPEN_READWRITE | SQLite::OPEN_CREATE);
  migrate(made);
  return schema_of(made);
}

std::string schema_of(const SQLite::Database& database) {
  std::string text;
  // ANALYZE, which anybody may run, leaves the tables of statistics.
  SQLite::Statement rows(
      database,
      "SELECT type, name, tbl_name, coalesce(sql, '') FROM sqlite_schema WHERE NOT (type = 'table' AND name "
      "IN ('sqlite_stat1', 'sqlite_stat4')) ORDER BY type, name");
  while (rows.executeStep()) {
    for (int column = 0; column < 4; ++column) text += rows.getColumn(column).getString() + "\n";
  }
  return text;
}

}  // namespace lightstage::db
