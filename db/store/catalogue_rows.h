// Whole catalogues, row by row: copied, added to and compared.
//
// Reading a damaged one (open_sound_pages) fails on damaged pages; these functions step over them. Rows are told apart by what stands in them, never by
// SQLite's hidden row numbers, which are given again once they are free.
#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include <SQLiteCpp/Database.h>

namespace lightstage::db {

// Which store a catalogue is of, whatever folder it lies in; empty where that cannot be read.
std::string store_id(SQLite::Database& database);

// Copies every row that can be read into a catalogue that holds none (but for its identity, which is replaced), and returns how many. Rows that break the
// tables' rules stay behind. Foreign keys must be off in `to`.
std::size_t copy_readable_rows(SQLite::Database& from, SQLite::Database& to);

struct AddedRows {
  std::size_t count = 0;
  // "scan 'head', made 2026-...": number or name belong to another one in the catalogue, as where both grew out of an older one.
  std::vector<std::string> clashes;
};
// Adds what a catalogue lacks of another of the same store; what it has stays. Scans and products that clash are left out whole, with all that hangs on them.
AddedRows add_missing_rows(SQLite::Database& from, SQLite::Database& to);

// What `from` has and `to` lacks: a line for each scan ("scan 'head': 35 frames from step 3 on") and kind of product. Empty when nothing is lacking.
// A scan's provenance, which extending it replaces, and objects' sizes, which their files know, do not count. A look-up for each row.
std::vector<std::string> missing_rows(SQLite::Database& from, SQLite::Database& to);
// The same of a damaged catalogue: its indexes, which lie on pages of their own, know the keys of rows that cannot be read. Tables of which neither all
// rows nor the index can be read are named.
std::vector<std::string> missing_keys(SQLite::Database& damaged, SQLite::Database& to);

}  // namespace lightstage::db
