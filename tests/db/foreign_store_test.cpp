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
#include "db/scene.h"
#include "db/store.h"
#include "support/support.h"

namespace fs = std::filesystem;
using namespace lightstage;
using Catch::Contains;

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
