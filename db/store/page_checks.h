// Checksums of the catalogue's pages, so that a flipped bit in store.sqlite is found and never taken for a row.
//
// SQLite leaves the last bytes of every page to whoever asks for them (https://www.sqlite.org/fileformat.html, section 1.3.4, "reserved bytes per
// page"). A layer between SQLite and the file (https://www.sqlite.org/vfs.html) fills eight of them with the XXH3 hash of the page and its number
// whenever the page is written to the database file, and compares whenever it is read. The write-ahead log has checksums of its own. A program that
// writes to store.sqlite without this layer leaves pages that do not match; to look is harmless.
#pragma once

#include <cstddef>
#include <filesystem>
#include <vector>

#include <SQLiteCpp/Database.h>

namespace lightstage::db {

// Opens with the layer in between; flags and errors are SQLite's. A new file will have checksums. Reading a page that does
// not match fails with SQLITE_IOERR_DATA.
SQLite::Database open_checked(const std::filesystem::path& path, int flags, int busy_timeout_ms = 0);

bool has_page_checks(const SQLite::Database& database);
// Rewrites the file of a database that was made without. Fails as VACUUM does: then nothing has changed.
void add_page_checks(SQLite::Database& database);

// Whether this connection compares from now on; it does from the start. Without, pages are taken as they are: it must not write then.
void check_pages(SQLite::Database& database, bool checking);

// The numbers (from 1) of all pages of the file that do not match their checksums, free ones too. In a file whose header knows of no checksums that
// is the first. Reads the
// file itself, at the disk's speed; a page that is being written meanwhile is looked at again.
std::vector<std::size_t> damaged_pages(const std::filesystem::path& catalogue);

}  // namespace lightstage::db
