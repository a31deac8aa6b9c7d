#include <sqlite3.h>

#include <SQLiteCpp/SQLiteCpp.h>
#include <catch2/catch.hpp>
#include <thread>

#include "core/error.h"
#include "db/scene.h"
#include "db/store.h"
#include "support/support.h"

using namespace lightstage;
using Catch::Matchers::Contains;
using Catch::Matchers::Equals;
using test::message_of;
namespace fs = std::filesystem;

TEST_CASE("a new store opens again and is sound") {
  const test::TemporaryFolder folder;
  { const db::Store store = db::Store::create(folder / "store"); }
  const db::Store store = db::Store::open(folder / "store");
  CHECK(store.folder() == folder / "store");
  CHECK(store.scans().empty());
  const db::VerifyReport report = store.verify();
  CHECK(report.errors == std::vector<std::string>());
  CHECK(report.notes == std::vector<std::string>());
  CHECK(report.frames == 0);
  CHECK(report.objects == 0);
}

TEST_CASE("a closed store leaves no journal behind") {
  const test::TemporaryFolder folder;
  { db::Store::create(folder / "store").add_scan(test::olat_scan("a", 3)); }
  CHECK(fs::exists(folder / "store/store.sqlite"));
  CHECK_FALSE(fs::exists(folder / "store/store.sqlite-wal"));
  CHECK_FALSE(fs::exists(folder / "store/store.sqlite-shm"));
}

TEST_CASE("a store is not made where there is one") {
  const test::TemporaryFolder folder;
  const std::string path = (folder / "store").string();
  { db::Store::create(path).add_scan(test::olat_scan("kept", 1)); }
  const auto before = test::snapshot(path);
  CHECK_THROWS_AS(db::Store::create(path), core::UsageError);
  CHECK_THAT(message_of([&] { db::Store::create(path); }), Equals(path + ": there is a store already"));
  CHECK(test::snapshot(path) == before);
}

TEST_CASE("creation that was cut short can be done again") {
  const test::TemporaryFolder folder;
  fs::create_directories(folder / "store");
  test::write_text(folder / "store/store.sqlite", "");  // what a crash in the first transaction leaves
  CHECK_THROWS_AS(db::Store::open(folder / "store"), core::StoreError);
  CHECK(db::Store::create(folder / "store").scans().empty());
}

TEST_CASE("a missing store is refused with the way to make one, and not made") {
  const test::TemporaryFolder folder;
  const std::string path = (folder / "nowhere").string();
  CHECK_THROWS_AS(db::Store::open(path), core::StoreError);
  CHECK_THAT(message_of([&] { db::Store::open(path); }),
             Equals(path + ": there is no store here (no store.sqlite); make one with `lightstage init --store " +
                    path + "`"));
  CHECK_FALSE(fs::exists(path));
}

TEST_CASE("a file that is no store is refused and stays as it is") {
  const test::TemporaryFolder folder;
  const fs::path path = folder / "store.sqlite";
  const auto refused = [&] {
    const auto before = test::snapshot(folder.path());
    CHECK_THROWS_AS(db::Store::open(folder.path()), core::StoreError);
    CHECK_THAT(message_of([&] { db::Store::open(folder.path()); }),
               Equals(path.string() + ": this file is not a Lightstage store"));
    CHECK(test::snapshot(folder.path()) == before);
  };
  SECTION("text") {
    test::write_text(path, std::string(5000, 'x'));
    refused();
  }
  SECTION("empty") {
    test::write_text(path, "");
    refused();
  }
  SECTION("shorter than a header") {
    test::write_text(path, "SQLite format 3");
    refused();
  }
  SECTION("a database of another program") {
    SQLite::Database(path.string(), SQLite::OPEN_READWRITE | SQLite::OPEN_CREATE).exec("CREATE TABLE t (x)");
    refused();
  }
  SECTION("a folder") {
    fs::create_directory(path);
    CHECK_THROWS_AS(db::Store::open(folder.path()), core::StoreError);
  }
}

TEST_CASE("a store of a newer version is refused and not touched") {
  const test::TemporaryFolder folder;
  const fs::path path = folder / "store";
  { db::Store::create(path).add_scan(test::olat_scan("a", 3)); }
  bool in_log = false;
  SECTION("in the database itself") {}
  SECTION("in its write-ahead log only, as after a crash") {
    in_log = true;
  }
  {
    SQLite::Database newer((path / "store.sqlite").string(), SQLite::OPEN_READWRITE);
    if (in_log) sqlite3_db_config(newer.getHandle(), SQLITE_DBCONFIG_NO_CKPT_ON_CLOSE, 1, nullptr);
    newer.exec("PRAGMA user_version = 99");
  }
  fs::remove(path / "store.sqlite-shm");  // does not survive a reboot
  CHECK(fs::exists(path / "store.sqlite-wal") == in_log);
  const auto before = test::snapshot(path);
  CHECK_THROWS_AS(db::Store::open(path), core::StoreError);
  CHECK_THAT(
      message_of([&] { db::Store::open(path); }),
      Equals(path.string() + ": this store has schema version 99, this program knows version 2; it was not touched. "
                             "Use the newer lightstage that made it"));
  CHECK(test::snapshot(path) == before);
}

TEST_CASE("what a crash left in the log is there again") {
  const test::TemporaryFolder folder;
  const fs::path path = folder / "store", copy = folder / "copy";
  {
    db::Store store = db::Store::create(path);
    store.add_scan(test::olat_scan("a", 3));
    fs::copy(path, copy, fs::copy_options::recursive);  // as a power cut would freeze it
  }
  REQUIRE(fs::file_size(copy / "store.sqlite-wal") > 0);
  fs::remove(copy / "store.sqlite-shm");
  CHECK(db::Store::open(copy).scan("a").steps.size() == 3);
}

TEST_CASE("the settings of a connection are those the store promises") {
  const test::TemporaryFolder folder;
  db::Store store = db::Store::create(folder / "store");
  const SQLite::Database look((folder / "store/store.sqlite").string(), SQLite::OPEN_READONLY);
  CHECK(SQLite::Statement(look, "PRAGMA user_version").executeStep());
  SQLite::Statement mode(look, "PRAGMA journal_mode");
  REQUIRE(mode.executeStep());
  CHECK(mode.getColumn(0).getString() == "wal");
  // Foreign keys are enforced: a product of a scan that does not exist cannot be added.
  db::NewProduct product;
  product.kind = "mask";
  product.scan_id = 77;
  CHECK_THROWS_AS(store.add_product(product), core::StoreError);
  CHECK(store.products("mask").empty());
}

TEST_CASE("a store lives in folders with any name") {
  const test::TemporaryFolder folder;
  const fs::path path = folder / "Bühne 1 – 光のステージ/o'store";
  const core::Image image = test::half_pattern(5, 7, 3, 1);
  db::ContentHash hash;
  {
    db::Store store = db::Store::create(path);
    const db::Id id = store.add_scan(test::olat_scan("a", 1));
    store.put_frame({.scan_id = id, .camera = "main", .step_index = 0}, image);
    hash = store.frames(id).front().object;
  }
  CHECK(db::Store::open(path).object(hash) == image);
  CHECK_THAT(message_of([&] { db::Store::create(path); }), Contains("光のステージ"));
}

TEST_CASE("a second connection sees what the first has committed, also after that is closed") {
  const test::TemporaryFolder folder;
  auto first = std::make_unique<db::Store>(db::Store::create(folder / "store"));
  db::Store second = db::Store::open(folder / "store");
  const db::Id id = first->add_scan(test::olat_scan("a", 2));
  CHECK(second.scan("a").id == id);
  first->put_frame({.scan_id = id, .camera = "main", .step_index = 0}, test::half_pattern(3, 4, 1, 0));
  CHECK(second.frames(id).size() == 1);
  first.reset();
  second.put_frame({.scan_id = id, .camera = "main", .step_index = 1}, test::half_pattern(3, 4, 1, 1));
  CHECK(second.frames(id).size() == 2);
  CHECK(second.object(second.frames(id)[0].object) == test::half_pattern(3, 4, 1, 0));
}

TEST_CASE("threads with a connection each write at the same time") {
  const test::TemporaryFolder folder;
  constexpr int kThreads = 4, kFrames = 12;
  const db::Id id = db::Store::create(folder / "store").add_scan(test::olat_scan("a", kThreads * kFrames));
  std::vector<std::string> failures(kThreads);
  std::vector<std::thread> threads;
  for (int t = 0; t < kThreads; ++t) {
    threads.emplace_back([&, t] {
      failures[std::size_t(t)] = message_of([&] {
        for (int i = 0; i < kFrames; ++i) {
          // Opening again and again, also while others write and close.
          db::Store store = db::Store::open(folder / "store");
          const int step = i * kThreads + t;
          // Every other image is the same one, so that threads meet at one object.
          store.put_frame({.scan_id = id, .camera = "main", .step_index = step},
                          test::half_pattern(8, 8, 3, i % 2 == 0 ? 0 : step));
        }
      });
    });
  }
  for (std::thread& thread : threads) thread.join();
  CHECK(failures == std::vector<std::string>(kThreads));
  const db::Store store = db::Store::open(folder / "store");
  const auto frames = store.frames(id, "main");
  REQUIRE(frames.size() == kThreads * kFrames);
  for (const db::Frame& frame : frames) {
    const int i = frame.step_index / kThreads;
    CHECK(store.object(frame.object) == test::half_pattern(8, 8, 3, i % 2 == 0 ? 0 : frame.step_index));
  }
  const db::VerifyReport report = store.verify();
  CHECK(report.errors == std::vector<std::string>());
  CHECK(report.notes == std::vector<std::string>());
}

TEST_CASE("a transaction keeps all or nothing") {
  const test::TemporaryFolder folder;
  db::Store store = db::Store::create(folder / "store");
  store.atomically([&] {
    store.add_scan(test::olat_scan("a", 1));
    store.atomically([&] { store.add_scan(test::olat_scan("b", 1)); });
    CHECK(db::Store::open(folder / "store").scans().empty());
  });
  CHECK(store.scans().size() == 2);
  CHECK_THROWS_AS(store.atomically([&] {
    store.add_scan(test::olat_scan("c", 1));
    store.add_scan(test::olat_scan("a", 1));
  }),
                  core::UsageError);
  CHECK(store.scans().size() == 2);
  // A part that fails and is caught goes alone.
  store.atomically([&] {
    store.add_scan(test::olat_scan("c", 1));
    CHECK_THROWS_AS(store.atomically([&] {
      store.add_scan(test::olat_scan("d", 1));
      throw core::BadInput("no");
    }),
                    core::BadInput);
  });
  CHECK(store.scans().size() == 3);
  CHECK_FALSE(store.find_scan("d"));
}
