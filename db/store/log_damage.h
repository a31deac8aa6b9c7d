// Damage in the write-ahead log that a crash has left (store.sqlite-wal).
//
// SQLite takes a log for as long as its checksums hold, folds that into the database and removes the file: what follows a flipped bit is gone, and nobody is told
// (https://www.sqlite.org/fileformat.html, section 4). So the log is looked at before SQLite opens the catalogue, and a damaged one stops every command but `store repair`.
//
// A crash leaves such a place too, where a page of the last transaction is torn or never came to the disk. What was acknowledged ends before it, because every transaction
// is synced before the next begins. So a log is damaged
// * where one wrong bit explains why the checksum fails. Sums of 64 bits tell which one it is, but for the highest bits of words, where it may be one of several: repair puts it right where it is
//   known, or where a later transaction has written the same page again;
// * where behind the page that fails the sums go on over a transaction that is not the one that this page is of.
// Several wrong bits in the last transaction are taken for a torn one, as SQLite does: nobody can tell them apart.
#pragma once

#include <cstddef>
#include <filesystem>

namespace lightstage::db {

// Throws StoreError, with what to do, when the log beside the store's catalogue is damaged. Changes nothing, and others may write to the store meanwhile. Reads the log.
void refuse_damaged_log(const std::filesystem::path& store_folder);

struct LogRepair {
  std::filesystem::path damaged_copy;  // empty: it was sound, and nothing was done
  std::size_t bits = 0;                // that were put right
  std::size_t pages_lost = 0;          // of transactions behind the damage that is left
};

// Keeps a copy of a damaged log, puts right what can be and cuts off the rest. Throws StoreError when another program has the store open.
LogRepair repair_log(const std::filesystem::path& store_folder);

// store.sqlite-wal.damaged-1 and so on.
std::filesystem::path log_path(const std::filesystem::path& store_folder);

}  // namespace lightstage::db
