// Checksums of the catalogue's pages, so that a flipped bit in store.sqlite is found and never taken for a row.
//
// SQLite leaves the last bytes of every page to whoever asks for them (https://www.sqlite.org/fileformat.html, section 1.3.4, "reserved bytes per
// page"). A layer between SQLite and the file (https://www.sqlite.org/vfs.html) fills eight of them with the XXH3 hash of the page and its number
// whenever the page is written to the database file, and compares whenever it is read. The write-ahead log has checksums of its own.
//
// Another program that writes to store.sqlite, be it that it only looks and in closing folds a log into the file that a crash has left, leaves
// pages that do not match. So a page that does not match is no reason to stop: it is read, and stays marked as not matching when it is written
// again, until verification tells of it and the user decides (`store repair`).
#pragma once

#include <cstddef>
#include <filesystem>
#include <optional>
#include <vector>

#include <SQLiteCpp/Database.h>

namespace lightstage::db {

// Opens with the layer in between; flags and errors are SQLite's. A new file will have checksums.
SQLite::Database open_checked(const std::filesystem::path& path, int flags, int busy_timeout_ms = 0);

// The database for reading the rows on sound pages alone; any other fails with SQLITE_IOERR_DATA. Nothing where not even the schema can be read. Of the first
// page we know what most of it must be, so it may be damaged.
std::optional<SQLite::Database> open_sound_pages(const std::filesystem::path& path);
// The same, but pages that one flipped bit has damaged are put right as they are read (page_sum.h).
std::optional<SQLite::Database> open_mended_pages(const std::filesystem::path& path);

bool has_page_checks(const SQLite::Database& database);
// Gives every page a checksum of what it is now. Fails as VACUUM does: then nothing has changed.
void renew_page_checks(SQLite::Database& database);

// The numbers (from 1) of all pages of the file that do not match their checksums, free ones too. In a file whose header knows of no checksums that
// is the first. Reads the
// file itself, at the disk's speed; a page that is being written meanwhile is looked at again.
std::vector<std::size_t> damaged_pages(const std::filesystem::path& catalogue);

// Whether one flipped bit is all that is wrong with each of these pages: then they were damaged, and not written by another program. Some 10 ms a page.
bool one_bit_flipped(const std::filesystem::path& catalogue, const std::vector<std::size_t>& pages);

}  // namespace lightstage::db
