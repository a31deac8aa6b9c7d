// What a backup alone has: kept, named, and brought back; and from which backups a store is mended.
#include <catch2/catch.hpp>

#include "core/error.h"
#include "core/file_lock.h"
#include "db/scene.h"
#include "db/store.h"
#include "support/support.h"

using namespace lightstage;
using Catch::Matchers::Contains;
using test::message_of;
namespace fs = std::filesystem;

namespace {

constexpr int kLights = 6;
constexpr std::chrono::seconds kNow{0};

db::Id begin_pass(db::Store& store, const std::string& name) {
  return store.add_scan(test::olat_scan(name, kLights));
}

void take(db::Store& store, db::Id scan, int first, int last, int seed) {
  for (int i = first; i < last; ++i) {
    store.put_frame({.scan_id = scan, .camera = "main", .step_index = i}, test::half_pattern(9, 7, 3, seed + i));
  }
}

void add_pass(db::Store& store, const std::string& name, int seed) {
  take(store, begin_pass(store, name), 0, kLights, seed);
}

struct Copies {
  test::TemporaryFolder folder;
  fs::path at = folder / "store", backup = folder / "backup";
  db::Store store = db::Store::create(at);

  Copies() {
    add_pass(store, "head", 100);
    db::NewProduct mask;
    mask.kind = "mask";
    mask.scan_id = store.scan("head").id;
    mask.images = {{"mask", 0, store.put_object(test::half_pattern(9, 7, 1, 7)), 0}};
    store.add_product(mask);
  }
};

std::vector<std::string> frames_of(const fs::path& folder) {
  const db::Store store = db::Store::open(folder);
  std::vector<std::string> lines;
  for (const db::Scan& scan : store.scans()) {
    for (const db::Frame& frame : store.frames(scan.id)) {
      lines.push_back(scan.name + " " + std::to_string(frame.step_index) + " " + frame.object.hex());
    }
  }
  return lines;
}

// As `store repair --from` does.
db::CatalogueRepair repair(const fs::path& folder, const std::vector<fs::path>& backups) {
  db::CatalogueRepair report = db::Store::repair_catalogue(folder, backups);
  CHECK(db::Store::open(folder).repair(backups).lost.empty());
  return report;
}

std::vector<std::string> names_in(const fs::path& folder) {
  std::vector<std::string> names;
  for (const auto& entry : fs::directory_iterator(folder)) names.push_back(entry.path().filename().string());
  std::sort(names.begin(), names.end());
  return names;
}

}  // namespace

TEST_CASE_METHOD(Copies, "a scan that was removed stays in the backup, and comes back from there") {
  store.back_up(backup);
  const auto before = frames_of(at);
  store.remove_scan(store.scan("head").id);
  const db::BackupReport report = store.back_up(backup);
  REQUIRE(report.gone.size() == 2);
  CHECK_THAT(report.gone[0], Contains("scan 'head' as a whole: 6 frames"));
  CHECK_THAT(report.gone[1], Contains("products: 1 row"));
  REQUIRE(fs::exists(report.kept_catalogue));
  CHECK_THAT(report.kept_catalogue.filename().string(), Catch::StartsWith("store.sqlite.before-2"));
  CHECK(frames_of(backup).empty());
  CHECK(db::Store::open(backup).collect_garbage(kNow).objects == 0);
  CHECK(store.collect_garbage(kNow).objects == kLights + 1);
  CHECK(store.back_up(backup).gone.empty());
  CHECK(db::Store::repair_catalogue(at, {backup}).rows_from_backups == 0);  // it was removed on purpose

  SECTION("into the store") {
    CHECK(repair(at, {report.kept_catalogue}).rows_from_backups > 2 * kLights);
    CHECK(frames_of(at) == before);
    const db::Store again = db::Store::open(at);
    CHECK(again.newest_product("mask", again.scan("head").id).has_value());
    CHECK(again.verify().errors == std::vector<std::string>());
    CHECK(repair(at, {report.kept_catalogue}).rows_from_backups == 0);
  }
  SECTION("into a store of its own") {
    db::Store::restore(report.kept_catalogue, folder / "again");
    CHECK(frames_of(folder / "again") == before);
    CHECK(db::Store::open(folder / "again").verify().errors == std::vector<std::string>());
  }
  SECTION("unless the kept catalogue is removed") {
    fs::remove(report.kept_catalogue);
    CHECK(db::Store::open(backup).collect_garbage(kNow).objects == kLights + 1);
  }
  SECTION("and not from a catalogue that is damaged, for whose sake nothing is removed either") {
    std::string bytes = test::read_text(report.kept_catalogue);
    bytes[5000] = char(bytes[5000] ^ 3);
    test::write_text(report.kept_catalogue, bytes);
    CHECK_THAT(message_of([&] { db::Store::repair_catalogue(at, {report.kept_catalogue}); }), Contains("is damaged"));
    CHECK_THAT(message_of([&] { db::Store::open(backup).collect_garbage(kNow); }), Contains("is damaged"));
  }
}

TEST_CASE_METHOD(Copies, "an older store does not push what is newer out of a backup") {
  store.back_up(folder / "old");
  add_pass(store, "newer", 200);
  store.back_up(backup);
  const auto newer = frames_of(at);
  db::Store::restore(folder / "old", folder / "older");
  db::Store older = db::Store::open(folder / "older");
  const db::BackupReport report = older.back_up(backup);
  REQUIRE(report.gone.size() == 1);
  CHECK_THAT(report.gone[0], Contains("scan 'newer' as a whole"));

  // Another scan has come to have its number meanwhile: neither takes the other's frames.
  add_pass(older, "other", 300);
  const auto own = frames_of(folder / "older");
  const db::CatalogueRepair refused = repair(folder / "older", {report.kept_catalogue});
  REQUIRE(refused.clashes.size() == 1);
  CHECK_THAT(refused.clashes[0], Contains("scan 'newer', made "));
  CHECK(refused.rows_from_backups == 0);
  CHECK(frames_of(folder / "older") == own);
  db::Store::restore(report.kept_catalogue, folder / "again");
  CHECK(frames_of(folder / "again") == newer);
}

TEST_CASE_METHOD(Copies, "frames that a backup alone has come back one by one") {
  const db::Id scan = begin_pass(store, "pass");
  take(store, scan, 0, 2, 400);
  store.back_up(folder / "old");
  take(store, scan, 2, kLights, 400);
  store.back_up(backup);
  const auto all = frames_of(at);
  db::Store::restore(folder / "old", folder / "older");
  db::Store older = db::Store::open(folder / "older");
  // Its next frame gets the number that another frame has in the backup.
  take(older, older.scan("pass").id, 5, 6, 400);
  const db::BackupReport report = older.back_up(backup);
  REQUIRE(report.gone.size() == 1);
  CHECK_THAT(report.gone[0],
             Contains("scan 'pass': 4 frames from step 2 on") || Contains("scan 'pass': 3 frames from step 2 on"));
  CHECK(repair(folder / "older", {report.kept_catalogue}).rows_from_backups >= 3);
  CHECK(frames_of(folder / "older") == all);
  CHECK(older.back_up(folder / "fresh").gone.empty());
}

TEST_CASE_METHOD(Copies, "a lost catalogue is made of a backup of this store, not of another's") {
  store.back_up(backup);
  const auto before = frames_of(at);
  {
    db::Store other = db::Store::create(folder / "other");
    add_pass(other, "stranger", 900);
    other.back_up(folder / "others");
    store = db::Store::open(folder / "other");
  }
  fs::remove(at / "store.sqlite");
  const std::string missing = message_of([&] { db::Store::open(at); });
  CHECK_THAT(missing, Contains("is missing") && Contains("store repair --store") && !Contains("init"));
  test::write_text(at / "store.sqlite", "");
  CHECK_THAT(message_of([&] { db::Store::open(at); }), Contains("is empty") && Contains("store repair --store"));
  CHECK_THAT(message_of([&] { db::Store::create(at); }),
             Contains("there are objects of a store here") && Contains("store repair --store"));
  CHECK_THROWS_AS(db::Store::create(at), core::UsageError);
  if (GENERATE(true, false)) fs::remove(at / "store.sqlite");

  const auto untouched = test::snapshot(at);
  CHECK_THAT(message_of([&] { db::Store::repair_catalogue(at, {folder / "others"}); }),
             Contains("of the 6 objects of this backup 0 are in"));
  CHECK_THAT(message_of([&] {
               db::Store::repair_catalogue(at, {folder / "others", backup});
             }),
             Contains("backup of another store than"));
  CHECK_THAT(message_of([&] { db::Store::restore(folder / "others", at); }), Contains("7 objects here are not of"));
  CHECK(test::snapshot(at) == untouched);

  const db::CatalogueRepair report = repair(at, {backup});
  CHECK(report.made_anew);
  CHECK(report.damaged_copy.empty());
  CHECK(frames_of(at) == before);
  CHECK(fs::exists(at / "store.sqlite.missing-1"));
  CHECK_THAT(message_of([&] { db::Store::open(at).collect_garbage(kNow); }), Contains("store.sqlite.missing-1"));
  CHECK(db::Store::open(at).back_up(backup).gone.empty());  // it is the same store again
}

TEST_CASE_METHOD(Copies, "one copy at a time into a folder, and nothing is collected there meanwhile") {
  store.back_up(backup);
  {
    const core::FileLock held(backup);
    CHECK_THAT(message_of([&] { store.back_up(backup); }), Contains("is at work on the objects in this folder"));
    CHECK_THAT(message_of([&] { db::Store::open(backup).collect_garbage(kNow); }), Contains("is at work"));
  }
  test::write_text(backup / "incoming.sqlite", "my own");
  test::write_text(backup / "store.sqlite.incoming", "left by one that was killed");
  store.back_up(backup);
  CHECK(test::read_text(backup / "incoming.sqlite") == "my own");
  CHECK(names_in(backup) == std::vector<std::string>{"incoming.sqlite", "objects", "store.sqlite"});
}

TEST_CASE_METHOD(Copies, "a copy lies neither in the store nor round it") {
  fs::create_directory_symlink(at / "objects", folder / "link");
  const auto before = test::snapshot(at);
  for (const fs::path& inside : {at, at / "objects", at / "objects/ab", at / "new/folder", folder / "link",
                                 folder / "link/deeper", folder / "nowhere/../store/objects"}) {
    CAPTURE(inside);
    CHECK_THROWS_AS(store.back_up(inside), core::UsageError);
    CHECK_THAT(message_of([&] { store.back_up(inside); }), Contains("the store itself or a folder in it"));
  }
  CHECK_THAT(message_of([&] { store.back_up(folder / "."); }), Contains("lies in this folder"));
  CHECK_THROWS_AS(store.back_up(""), core::UsageError);
  CHECK(test::snapshot(at) == before);
  CHECK(names_in(folder / ".") == std::vector<std::string>{"link", "store"});
  store.back_up(folder / "store-backup");  // a name that begins alike
}

TEST_CASE_METHOD(Copies, "a copy of another size is made anew, a sound one kept where the store's own is cut") {
  store.back_up(backup);
  const auto objects = test::snapshot(backup / "objects");
  const fs::path mine = store.object_path(store.frames(store.scan("head").id)[2].object);
  const fs::path copy = backup / "objects" / fs::relative(mine, at / "objects");
  fs::resize_file(copy, 0);
  CHECK(store.back_up(backup).copied == 1);
  CHECK(test::snapshot(backup / "objects") == objects);
  fs::resize_file(mine, 5);
  const db::BackupReport report = store.back_up(backup);
  CHECK(report.copied == 0);
  CHECK(report.damaged.empty());
  CHECK(test::snapshot(backup / "objects") == objects);
  fs::resize_file(copy, 0);
  CHECK(store.back_up(backup).damaged.size() == 1);
}

TEST_CASE_METHOD(Copies, "a backup whose catalogue is damaged is mended before it is replaced") {
  store.back_up(backup);
  const std::string bytes = test::read_text(backup / "store.sqlite");
  std::string damaged = bytes;
  damaged[6000] = char(damaged[6000] ^ 3);
  test::write_text(backup / "store.sqlite", damaged);
  CHECK_THAT(message_of([&] { store.back_up(backup); }), Contains("store repair --store " + backup.string()));
  CHECK(test::read_text(backup / "store.sqlite") == damaged);
  db::Store::repair_catalogue(backup, {at});
  CHECK(store.back_up(backup).damaged.empty());
}
