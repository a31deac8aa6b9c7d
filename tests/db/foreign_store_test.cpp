// Stores from strangers: one clear line, whatever is in them.
#include <SQLiteCpp/Database.h>
#include <sqlite3.h>
#include <sys/stat.h>

#include <catch2/catch.hpp>
#include <filesystem>
#include <fstream>

#include "core/error.h"
#include "core/printable.h"
#include "db/scan_loader.h"
#include "db/scan_lock.h"
#include "db/scene.h"
#include "db/store.h"
#include "support/support.h"

namespace fs = std::filesystem;
using namespace lightstage;
using Catch::Contains;
using Catch::Equals;

namespace {

struct ForeignStore {
  test::TemporaryFolder folder;
  fs::path path = folder / "store";
  fs::path file = path / "store.sqlite";

  ForeignStore() {
    db::Store store = db::Store::create(path);
    const db::NewScan scan = test::olat_scan("head", 3);
    const db::Id id = store.add_scan(scan);
    for (int i = 0; i < 3; ++i) {
      store.put_frame({.scan_id = id, .camera = "main", .step_index = i}, test::half_pattern(4, 5, 3, i));
    }
    std::vector<db::CalibratedLight> lights;
    for (const core::Direction& d : test::front_lights(3)) {
      lights.push_back({.light_index = int(lights.size()), .light = {d}});
    }
    store.add_calibration({.kind = "calibration", .scan_id = id, .stage_key = scan.stage_key}, lights);
  }

  // Past all that the tables check.
  void change(const std::string& sql) const {
    SQLite::Database raw(file.string(), SQLite::OPEN_READWRITE);
    raw.exec("PRAGMA ignore_check_constraints = ON; PRAGMA foreign_keys = OFF");
    raw.exec(sql);
    raw.exec("PRAGMA wal_checkpoint(TRUNCATE)");
  }

  template <class Work>
  std::string refused(const Work& work) const {
    try {
      work();
    } catch (const core::StoreError& error) {
      const std::string said = error.what();
      CHECK_THAT(said, Contains(path.string()));
      CHECK(said.size() < 600);
      return said;
    }
    FAIL("was taken");
    return {};
  }
  std::string refused_at_opening() const {
    return refused([&] { db::Store::open(path); });
  }
};

}  // namespace

TEST_CASE("a schema that is not this program's is refused before anything is read through it") {
  const ForeignStore foreign;
  SECTION("trigger") {
    foreign.change("CREATE TRIGGER t AFTER INSERT ON scans BEGIN DELETE FROM frames; END");
    CHECK_THAT(foreign.refused_at_opening(), Contains("it holds a trigger 't'"));
  }
  SECTION("view in the place of a table") {
    foreign.change("DROP TABLE identity; CREATE VIEW identity AS SELECT 1 AS only, hex(zeroblob(16)) AS store_id");
    CHECK_THAT(foreign.refused_at_opening(), Contains("view 'identity'"));
  }
  SECTION("a trigger with a name that looks like SQLite's own") {
    foreign.change("CREATE TRIGGER sqliteXt AFTER INSERT ON scans BEGIN DELETE FROM frames; END");
    CHECK_THAT(foreign.refused_at_opening(), Contains("trigger"));
  }
  SECTION("a column more") {
    foreign.change("ALTER TABLE scans ADD COLUMN extra TEXT DEFAULT 'x'");
    CHECK_THAT(foreign.refused_at_opening(), Contains("not those of schema version"));
  }
  SECTION("a name that moves the cursor") {
    foreign.change("CREATE TRIGGER \"\x1b[2J\" AFTER INSERT ON scans BEGIN DELETE FROM frames; END");
    const std::string said = foreign.refused_at_opening();
    CHECK(core::printable(said) == said);
  }
}

TEST_CASE("statistics of ANALYZE are no foreign schema") {
  const ForeignStore foreign;
  foreign.change("ANALYZE");
  CHECK_NOTHROW(db::Store::open(foreign.path));
}

TEST_CASE("rows that no lightstage writes are refused with their place") {
  const ForeignStore foreign;
  const auto ask = [&](const std::string& sql, const std::string& expected, const auto& work) {
    CAPTURE(sql);
    foreign.change(sql);
    const db::Store store = db::Store::open(foreign.path);
    CHECK_THAT(foreign.refused([&] { work(store); }), Contains(expected));
  };
  const auto scan = [](const db::Store& store) { store.scan("head"); };
  const auto frames = [](const db::Store& store) { store.frames(1); };
  const auto lights = [](const db::Store& store) { store.calibrated_lights(1); };
  SECTION("scans") {
    ask("UPDATE scans SET kind = 'x'", "no kind 'x'", scan);
  }
  SECTION("names as paths") {
    foreign.change("UPDATE scans SET name = '../../.bashrc'");
    const db::Store store = db::Store::open(foreign.path);
    CHECK_THAT(foreign.refused([&] { store.scans(); }), Contains("cannot name a scan"));
  }
  SECTION("cameras as paths") {
    ask("UPDATE cameras SET name = '/etc/x'", "cannot name a camera", scan);
  }
  SECTION("steps") {
    ask("UPDATE steps SET step_index = 4611686018427387904 WHERE step_index = 2", "out of range", scan);
  }
  SECTION("lights of steps") {
    ask("UPDATE steps SET light_index = NULL", "has a light exactly if", scan);
  }
  SECTION("deep JSON") {
    ask("UPDATE scans SET provenance = '" + std::string(100'000, '[') + "'", "levels deep", scan);
  }
  SECTION("frames") {
    ask("UPDATE frames SET step_index = 4611686018427387904 WHERE step_index = 2", "out of range", frames);
  }
  SECTION("object names as paths") {
    ask("UPDATE frames SET object = '../../../../../../../etc/passwd'", "not an object's name",
        [](const db::Store& store) {
          try {
            store.frames(1);
          } catch (const core::StoreError& error) {
            throw core::StoreError(store.folder().string() + ": " + error.what());
          }
        });
  }
  SECTION("directions") {
    ask("UPDATE calibrated_lights SET direction_x = 0, direction_y = 0, direction_z = 0", "light 0", lights);
  }
  SECTION("gains") {
    ask("UPDATE calibrated_lights SET gain_g = 0", "its gain", lights);
  }
  SECTION("sizes that would take the machine's memory") {
    ask("UPDATE objects SET height = 1000000, width = 1000000", "is not that of its file",
        [](const db::Store& store) { db::load_scan(store, "head"); });
  }
  SECTION("sizes beyond all") {
    ask("UPDATE objects SET height = 4611686018427387904", "out of range",
        [](const db::Store& store) { db::load_scan(store, "head"); });
  }
  SECTION("a value of more than 64 MiB") {
    ask("UPDATE scans SET provenance = hex(zeroblob(40000000))", "too big", scan);
  }
}

TEST_CASE("a quick check finds rows that break the tables' own rules") {
  const ForeignStore foreign;
  CHECK_NOTHROW(db::Store::open(foreign.path).require_sound_catalogue());
  foreign.change("UPDATE objects SET channels = 77");
  const db::Store store = db::Store::open(foreign.path);
  CHECK_THAT(foreign.refused([&] { store.require_sound_catalogue(); }), Contains("CHECK constraint failed in objects"));
}

TEST_CASE("links in a store are not followed out of it when something is written") {
  const ForeignStore foreign;
  std::ofstream(foreign.folder / "precious.txt") << "mine";
  const auto is_untouched = [&] { return test::read_text(foreign.folder / "precious.txt") == "mine"; };
  SECTION("the catalogue") {
    fs::rename(foreign.file, foreign.folder / "elsewhere.sqlite");
    fs::create_symlink(foreign.folder / "elsewhere.sqlite", foreign.file);
    CHECK_THAT(foreign.refused_at_opening(), Contains("symbolic link"));
  }
  SECTION("the state of a verification") {
    fs::create_symlink(foreign.folder / "precious.txt", foreign.path / "verify.json");
    CHECK(db::Store::open(foreign.path).verify().errors.empty());
    CHECK(is_untouched());
  }
  SECTION("an object") {
    db::Store store = db::Store::open(foreign.path);
    const core::Image image = test::half_pattern(4, 5, 3, 0);
    const fs::path object = store.object_path(store.frames(1)[0].object);
    fs::remove(object);
    fs::create_symlink(foreign.folder / "precious.txt", object);
    CHECK(store.object_path(store.put_object(image)) == object);
    CHECK(is_untouched());
    CHECK(fs::is_regular_file(fs::symlink_status(object)));
    CHECK(store.object(store.frames(1)[0].object).values()[3] == image.values()[3]);
  }
  SECTION("a folder of objects") {
    db::Store store = db::Store::open(foreign.path);
    const fs::path object = store.object_path(store.frames(1)[0].object);
    fs::create_directory(foreign.folder / "outside");
    fs::remove_all(object.parent_path());
    fs::create_directory_symlink(foreign.folder / "outside", object.parent_path());
    CHECK_THROWS_AS(store.put_object(test::half_pattern(4, 5, 3, 0)), core::StoreError);
    CHECK(fs::is_empty(foreign.folder / "outside"));
  }
}

TEST_CASE("a store or backup whose folders are links is not taken, and nothing goes through them") {
  const ForeignStore foreign;
  const fs::path victim = foreign.folder / "victim";
  fs::create_directory(victim);
  std::ofstream(victim / "thesis.txt") << "mine";
  const auto before = test::snapshot(victim);
  const auto is_refused = [&](const auto& work) { CHECK_THAT(foreign.refused(work), Contains("is a symbolic link")); };
  for (const char* name : {"objects", "locks", "models"}) {
    CAPTURE(name);
    const fs::path link = foreign.path / name, aside = foreign.folder / "aside";
    std::error_code none;
    fs::rename(link, aside, none);
    fs::create_directory_symlink("../victim", link);
    is_refused([&] { db::Store::open(foreign.path); });
    is_refused([&] { db::Store::repair_catalogue(foreign.path, {}); });
    is_refused([&] { db::ScanLock(foreign.path, "thesis.txt", "is being captured"); });
    const ForeignStore other;
    is_refused([&] { db::Store::open(other.path).back_up(foreign.path); });
    is_refused([&] { db::Store::open(other.path).repair({foreign.path}); });
    is_refused([&] { db::Store::restore(foreign.path, foreign.folder / "again"); });
    fs::rename(foreign.file, foreign.folder / "catalogue");
    is_refused([&] { db::Store::create(foreign.path); });
    is_refused([&] { db::Store::restore(other.path, foreign.path); });
    fs::rename(foreign.folder / "catalogue", foreign.file);
    fs::remove(link);
    fs::rename(aside, link, none);
  }
  CHECK(test::snapshot(victim) == before);
  CHECK(db::Store::open(foreign.path).verify().errors.empty());
}

TEST_CASE("what stands in the place of a scan's lock and is none stays as it is") {
  const ForeignStore foreign;
  const fs::path lock = foreign.path / "locks/head", thesis = foreign.folder / "thesis.txt";
  fs::create_directory(lock.parent_path());
  const auto is_refused = [&] {
    CHECK_THAT(foreign.refused([&] { db::ScanLock(foreign.path, "head", "is being captured"); }), Contains("lock"));
  };
  std::ofstream(thesis) << "17 chapters";
  SECTION("a file") {
    fs::rename(thesis, lock);
    is_refused();
    CHECK(test::read_text(lock) == "17 chapters");
  }
  SECTION("a second name of a file, even of an empty one") {
    std::ofstream(thesis, std::ios::trunc);
    fs::create_hard_link(thesis, lock);
    is_refused();
    CHECK(fs::exists(lock));
  }
  SECTION("a link") {
    fs::create_symlink(thesis, lock);
    is_refused();
    CHECK(test::read_text(thesis) == "17 chapters");
    CHECK(fs::is_symlink(lock));
  }
  SECTION("a pipe") {
    REQUIRE(mkfifo(lock.c_str(), 0600) == 0);
    is_refused();
  }
  SECTION("words whose end a power cut took are a lock's") {
    for (const char* left : {"", "17", "17 is b", "17 is being captured"}) {
      std::ofstream(lock) << left;
      db::ScanLock(foreign.path, "head", "is being captured");
      CHECK_FALSE(fs::exists(lock));
    }
    std::ofstream(lock) << std::string(22, '\0');
    db::ScanLock(foreign.path, "head", "is being captured");
    CHECK_FALSE(fs::exists(lock));
  }
}

TEST_CASE("what stands in an object's place and is no file is damage, which nobody opens, waits for or removes") {
  const ForeignStore foreign;
  db::Store store = db::Store::open(foreign.path);
  store.back_up(foreign.folder / "backup");
  const db::ContentHash hash = store.frames(1)[1].object;
  const fs::path object = store.object_path(hash);
  const auto check = [&](const std::string& what, bool mendable) {
    const auto errors = store.verify().errors;
    REQUIRE(errors.size() >= 1);
    CHECK_THAT(errors[0], Contains("scan 'head', step 1, camera 'main': object " + hash.hex() + " is damaged: ") &&
                              Contains(what));
    CHECK_THAT(test::message_of([&] { store.object(hash); }), Contains(what));
    CHECK_THAT(test::message_of([&] { store.back_up(foreign.folder / "late"); }), Equals(""));
    CHECK_FALSE(fs::exists(foreign.folder / "late/objects" / object.lexically_relative(foreign.path / "objects")));
    store.collect_garbage(std::chrono::seconds(0));
    CHECK(store.repair({}).lost.size() == 1);
    const db::RepairReport report = store.repair({foreign.folder / "backup"});
    if (mendable) {
      CHECK(report.mended.size() == 1);
      CHECK(store.verify().errors.empty());
    } else {
      REQUIRE(report.lost.size() == 1);
      CHECK_THAT(report.lost[0], Contains("move away what stands there"));
    }
  };
  SECTION("a link to the right bytes elsewhere") {
    fs::rename(object, foreign.folder / "elsewhere.exr");
    fs::create_symlink(foreign.folder / "elsewhere.exr", object);
    check("a symbolic link stands in its place", true);
    CHECK(fs::exists(foreign.folder / "elsewhere.exr"));
  }
  SECTION("a link to what has no end") {
    fs::remove(object);
    fs::create_symlink("/dev/zero", object);
    check("a symbolic link stands in its place", true);
  }
  SECTION("a pipe") {
    fs::remove(object);
    REQUIRE(mkfifo(object.c_str(), 0600) == 0);
    check("a pipe stands in its place", false);
  }
  SECTION("a folder") {
    fs::remove(object);
    fs::create_directory(object);
    check("a folder stands in its place", false);
  }
  SECTION("a link for their folder") {
    fs::rename(object.parent_path(), foreign.folder / "ab");
    fs::create_directory_symlink("../../ab", object.parent_path());
    check("is a symbolic link; objects lie in the store's own folders", false);
    CHECK(fs::exists(foreign.folder / "ab" / object.filename()));
  }
  SECTION("a file for their folder") {
    fs::remove_all(object.parent_path());
    std::ofstream(object.parent_path()) << "x";
    check("is a file; objects lie in the store's own folders", false);
  }
}

TEST_CASE("what is in the way of objects to come, or of others, is an error of the store") {
  const ForeignStore foreign;
  const db::Store store = db::Store::open(foreign.path);
  std::string free = "00";
  while (fs::exists(foreign.path / "objects" / free)) ++free[1];
  const fs::path place = foreign.path / "objects" / free;
  std::ofstream(foreign.folder / "thesis.txt") << "mine";
  SECTION("a file in the place of a folder") {
    std::ofstream(place) << "x";
  }
  SECTION("a link in the place of a folder") {
    fs::create_directory_symlink(foreign.folder.path(), place);
  }
  SECTION("a pipe") {
    fs::create_directory(place);
    REQUIRE(mkfifo((place / "x.exr").c_str(), 0600) == 0);
  }
  SECTION("a link") {
    fs::create_directory(place);
    fs::create_symlink(foreign.folder / "thesis.txt", place / "x.exr");
  }
  const auto report = store.verify();
  REQUIRE(report.errors.size() == 1);
  CHECK_THAT(report.errors[0], Contains(place.string()) && Contains("move it away"));
  CHECK(report.notes.empty());
  const auto before = test::snapshot(foreign.path / "objects");
  db::Store::open(foreign.path).collect_garbage(std::chrono::seconds(0));
  CHECK(test::snapshot(foreign.path / "objects") == before);
  CHECK(fs::exists(foreign.folder / "thesis.txt"));
}

TEST_CASE("what is no file in a file's place is refused, and nobody waits for it") {
  const ForeignStore foreign;
  fs::remove(foreign.file);
  SECTION("pipe") {
    REQUIRE(mkfifo(foreign.file.c_str(), 0600) == 0);
    CHECK_THAT(foreign.refused_at_opening(), Contains("not a Lightstage store"));
  }
  SECTION("folder") {
    fs::create_directory(foreign.file);
    CHECK_THAT(foreign.refused_at_opening(), Contains("not a Lightstage store"));
  }
  SECTION("another database") {
    SQLite::Database(foreign.file.string(), SQLite::OPEN_READWRITE | SQLite::OPEN_CREATE).exec("CREATE TABLE t (x)");
    CHECK_THAT(foreign.refused_at_opening(), Contains("not a Lightstage store"));
  }
}
