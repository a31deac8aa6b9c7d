// A catalogue may come from a stranger, and SQLite runs what a schema says: triggers, views, defaults and expressions. So nothing is
// read from one before its schema is known to be this program's own.
#pragma once

#include <filesystem>
#include <optional>
#include <string>

#include <SQLiteCpp/Database.h>

namespace lightstage::db {

// The connection runs no triggers and views and no functions of the schema, loads no code, does not let SQL touch the database's own pages, and
// takes no text or blob of more than 64 MiB. To be called before anything else. (SQLite's "Defense Against The Dark Arts".)
void distrust(SQLite::Database& database);

// Throws StoreError unless the tables and indexes are those of the catalogue's schema version and there is nothing else.
void require_own_schema(SQLite::Database& database, const std::filesystem::path& store_folder);

// What a quick check of all pages and rows finds first; nothing for a sound catalogue and for one of more than 4 MiB, which only `store verify` checks, since
// opening may not take long.
std::optional<std::string> quick_finding(SQLite::Database& database);

}  // namespace lightstage::db
