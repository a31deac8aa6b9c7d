// Keeps store.sqlite-wal short while several processes read and write.
#pragma once

#include <SQLiteCpp/Database.h>

namespace lightstage::db {

// So long a connection waits for others before it gives up.
constexpr int kBusyTimeoutMs = 20'000;
// What the log may grow to while nobody holds an old view of the catalogue for long: 16 MiB of pages, and one transaction.
constexpr int kMostLogPages = 4096;

// Sees to it that every transaction of this connection which leaves the log long copies it into the database. From 4 MiB on as far as that goes without waiting, as SQLite does by
// itself; where others' views keep the log from being begun anew until it has kMostLogPages, it waits for them for a moment (new ones begin behind it meanwhile) and cuts
// the file. Where a view stays open longer than that, it tries again four times a second: the log then grows for as long as the view is open.
void bound_log(SQLite::Database& database);

}  // namespace lightstage::db
