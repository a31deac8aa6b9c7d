// The catalogue's schema and how older ones become it.
#pragma once

#include <string>

#include <SQLiteCpp/Database.h>

namespace lightstage::db {

// `PRAGMA application_id` of every store: "LSTG".
constexpr int kApplicationId = 0x4C535447;
// `PRAGMA user_version` that this program reads and writes.
int schema_version();

// Brings the catalogue from its own version to a later one, all in one transaction; returns whether
// there was anything to do. An empty database has version 0. Throws SQLite::Exception.
bool migrate(SQLite::Database& database, int to = schema_version());

// The schema as text, one object after the other, as this database has it.
std::string schema_of(const SQLite::Database& database);
// What schema_of says of a catalogue that this program makes.
std::string current_schema();

}  // namespace lightstage::db
