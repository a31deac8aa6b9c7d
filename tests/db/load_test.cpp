// Several at work on one store: the write-ahead log stays short, and who waits is told for whom.
#include <SQLiteCpp/SQLiteCpp.h>
#include <fcntl.h>
#include <sqlite3.h>
#include <sys/wait.h>
#include <unistd.h>

#include <atomic>
#include <catch2/catch.hpp>
#include <thread>

#include "db/rows_bench.h"
#include "db/scene.h"
#include "db/store.h"
#include "db/store/catalogue.h"
#include "db/store/lock_holders.h"
#include "db/store/page_checks.h"
#include "db/store/write_ahead_log.h"
#include "support/support.h"

using namespace lightstage;
using Catch::Matchers::Contains;
namespace fs = std::filesystem;

namespace {

constexpr std::size_t kLights = 500;
// A page and its head in the log, and a transaction more.
constexpr std::uintmax_t kMostLogBytes = std::uintmax_t(db::kMostLogPages) * 4120 + (std::uintmax_t(1) << 20);

struct Fixture {
  test::TemporaryFolder folder;
  fs::path path = folder / "store";
  db::Store store = db::Store::create(path);
  std::vector<db::ContentHash> objects;
  int scans = 0;

  Fixture() {
    for (int i = 0; i < 20; ++i) objects.push_back(store.put_object(test::half_pattern(4, 4, 1, i)));
  }
  std::uintmax_t log_bytes() const {
    std::error_code error;
    const auto size = fs::file_size(path / "store.sqlite-wal", error);
    return error ? 0 : size;
  }
  // Each row in a transaction of its own, as cameras bring them; returns the longest that the log was.
  std::uintmax_t add_rows(std::size_t count) {
    std::uintmax_t longest = 0;
    for (std::size_t done = 0; done < count; done += kLights) {
      const db::Id id = store.add_scan(test::olat_scan("scan" + std::to_string(scans++), kLights));
      for (std::size_t i = 0; i < kLights; ++i) {
        store.add_frame({.scan_id = id, .camera = "main", .step_index = int(i)}, objects[i % objects.size()]);
        longest = std::max(longest, log_bytes());
      }
    }
    return longest;
  }
};

}  // namespace

TEST_CASE("the write-ahead log stays short while 20,000 rows are added and others read without a pause", "[long]") {
  Fixture fixture;
  std::atomic<bool> done = false;
  std::atomic<std::size_t> looks = 0;
  std::vector<std::thread> readers;
  for (int r = 0; r < 2; ++r) {  // two, so that somebody looks at any moment
    readers.emplace_back([&] {
      const db::Store store = db::Store::open(fixture.path);
      while (!done) {
        for (const db::ScanSummary& scan : store.scan_summaries()) {
          if (scan.frames > 0) store.frames(store.scan(scan.name).id, "main");
          if (done) break;
        }
        ++looks;
      }
    });
  }
  const std::uintmax_t longest = fixture.add_rows(20'000);
  done = true;
  for (std::thread& reader : readers) reader.join();
  INFO(longest << " bytes, " << looks << " looks");
  CHECK(longest > 0);
  // Half a gigabyte of pages went through it. It may be longer than kMostLogPages by what comes until readers are waited for again.
  CHECK(longest <= 4 * kMostLogBytes);
  CHECK(looks > 0);
  std::size_t frames = 0;
  for (const db::ScanSummary& scan : fixture.store.scan_summaries()) frames += scan.frames;
  CHECK(frames == 20'000);
}

TEST_CASE("a view that stays open lets the log grow, but stops no writer; once it is closed the log is cut") {
  Fixture fixture;
  std::uintmax_t grown = 0;
  {
    SQLite::Database viewer((fixture.path / "store.sqlite").string(), SQLite::OPEN_READONLY);
    SQLite::Transaction view(viewer);
    SQLite::Statement count(viewer, "SELECT COUNT(*) FROM frames");
    REQUIRE(count.executeStep());
    fixture.add_rows(2000);
    grown = fixture.log_bytes();
    CHECK(grown > kMostLogBytes);
    CHECK(viewer.execAndGet("SELECT COUNT(*) FROM frames").getInt() == 0);
  }
  fixture.add_rows(kLights);
  CHECK(fixture.log_bytes() <= kMostLogBytes);
}

TEST_CASE("whoever waits for too long is told for which program") {
  Fixture fixture;
  const auto busy = [&] {
    return std::string(db::explained(SQLite::Exception("locked", SQLITE_BUSY), fixture.path).what());
  };
  CHECK(db::lock_holders(fixture.path).empty());
  CHECK_THAT(busy(),
             Contains("another program has been writing to this store for too long; try again when it is done"));
  {
    SQLite::Database own((fixture.path / "store.sqlite").string(), SQLite::OPEN_READWRITE);
    SQLite::Transaction writing(own, SQLite::TransactionBehavior::IMMEDIATE);
    if (db::lock_holders(fixture.path).empty()) SKIP_TEST("this system does not tell who holds a lock (/proc/locks)");
    CHECK(db::lock_holders(fixture.path) == "this program itself");
  }
  CHECK(db::lock_holders(fixture.path).empty());

  int ready[2] = {}, go[2] = {};
  REQUIRE(pipe(ready) == 0);
  REQUIRE(pipe(go) == 0);
  const pid_t child = fork();
  REQUIRE(child >= 0);
  if (child == 0) {
    char byte = 0;
    {
      SQLite::Database own((fixture.path / "store.sqlite").string(), SQLite::OPEN_READWRITE);
      SQLite::Transaction writing(own, SQLite::TransactionBehavior::IMMEDIATE);
      if (write(ready[1], "r", 1) != 1 || read(go[0], &byte, 1) != 1) _exit(1);
    }
    _exit(0);
  }
  char byte = 0;
  REQUIRE(read(ready[0], &byte, 1) == 1);
  CHECK_THAT(busy(), Contains("process " + std::to_string(child) + " (") &&
                         Contains(") has been writing to this store for too long"));
  REQUIRE(write(go[1], "g", 1) == 1);
  int status = 0;
  REQUIRE(waitpid(child, &status, 0) == child);
  CHECK(status == 0);
  for (const int end : {ready[0], ready[1], go[0], go[1]}) close(end);
}

TEST_CASE("looking at the catalogue's file gives back none of the locks by which others see that it is in use") {
  Fixture fixture;
  // Of another process, since a process's own locks never stand in its way: whether the database file is held by somebody
  // (https://www.sqlite.org/src/file/src/os.h: the bytes that readers lock).
  const auto held = [&] {
    const pid_t child = fork();
    if (child == 0) {
      const int file = open((fixture.path / "store.sqlite").c_str(), O_RDWR);
      struct flock lock {};
      lock.l_type = F_WRLCK;
      lock.l_whence = SEEK_SET;
      lock.l_start = 0x40000002;
      lock.l_len = 510;
      _exit(file >= 0 && fcntl(file, F_GETLK, &lock) == 0 && lock.l_type != F_UNLCK ? 7 : 0);
    }
    int status = 0;
    waitpid(child, &status, 0);
    return WEXITSTATUS(status) == 7;
  };
  CHECK(held());
  CHECK(db::damaged_pages(fixture.path / "store.sqlite").empty());
  CHECK(held());
  { const db::Store other = db::Store::open(fixture.path); }
  CHECK(held());
  CHECK(fixture.store.verify().errors.empty());
  CHECK(held());
}

TEST_CASE("a large catalogue has what was entered, and its real scan is whole") {
  const test::TemporaryFolder folder;
  const db::RowsBench bench = db::bench_rows({.folder = folder / "store", .rows = 20'000, .lights = 50, .cameras = 4});
  CHECK(bench.rows == 20'000);
  CHECK(bench.scans == 100);
  CHECK(bench.start_ms > 0);
  CHECK(bench.list_ms > 0);
  CHECK(bench.verify_one_scan_ms > 0);
  const db::Store store = db::Store::open(folder / "store");
  CHECK(store.frames(store.scan("scan7").id).size() == 200);
  CHECK(store.verify({.scans = {"scan50"}}).errors.empty());
  CHECK(store.verify({.scans = {"scan7"}}).errors.size() == 200);  // names without objects are found
}
