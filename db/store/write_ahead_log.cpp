#include "db/store/write_ahead_log.h"

#include <sqlite3.h>

#include <atomic>
#include <chrono>

namespace lightstage::db {

namespace {

constexpr int kCheckpointPages = 1024;
// Cameras wait meanwhile, so a process tries it this often only.
constexpr int kWaitForReadersMs = 20;
constexpr std::chrono::milliseconds kBetweenWaits{250};

bool may_wait() {
  using Clock = std::chrono::steady_clock;
  static std::atomic<Clock::rep> next = 0;
  const Clock::rep now = Clock::now().time_since_epoch().count();
  Clock::rep due = next;
  return now >= due &&
         next.compare_exchange_strong(due, now + std::chrono::duration_cast<Clock::duration>(kBetweenWaits).count());
}

// What cannot be done now is done after a later transaction: the one before this is committed, whatever happens here.
int after_commit(void*, sqlite3* database, const char* name, int pages) {
  if (pages < kCheckpointPages) return SQLITE_OK;
  if (pages < kMostLogPages) {
    sqlite3_wal_checkpoint_v2(database, name, SQLITE_CHECKPOINT_PASSIVE, nullptr, nullptr);
    return SQLITE_OK;
  }
  sqlite3_busy_timeout(database, may_wait() ? kWaitForReadersMs : 0);
  sqlite3_wal_checkpoint_v2(database, name, SQLITE_CHECKPOINT_TRUNCATE, nullptr, nullptr);
  sqlite3_busy_timeout(database, kBusyTimeoutMs);
  return SQLITE_OK;
}

}  // namespace

void bound_log(SQLite::Database& database) {
  sqlite3_wal_hook(database.getHandle(), after_commit, nullptr);
}

}  // namespace lightstage::db
