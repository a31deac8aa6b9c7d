// Flipped bits in store.sqlite: found, named, and mended.
#include <SQLiteCpp/SQLiteCpp.h>
#include <catch2/catch.hpp>

#include <random>

#include "core/error.h"
#include "db/scene.h"
#include "db/store.h"
#include "support/support.h"

using namespace lightstage;
using Catch::Matchers::Contains;
using test::message_of;
namespace fs = std::filesystem;

namespace {

constexpr int kLights = 40;
constexpr std::size_t kPage = 4096;

void add_pass(db::Store& store, const std::string& name) {
  const db::Id scan_id = store.add_scan(test::olat_scan(name, kLights));
  const db::ContentHash object = store.put_object(test::half_pattern(3, 3, 3, int(scan_id)));
  store.atomically([&] {
    for (int i = 0; i < kLights; ++i) {
      store.add_frame({.scan_id = scan_id, .camera = "main", .step_index = i, .timestamp_ns = 1000 * i}, object);
    }
  });
}

// A closed store of three passes, and what it holds.
struct DamagedCatalogue {
  test::TemporaryFolder folder;
  fs::path store = folder / "store";
  fs::path file = store / "store.sqlite";
  std::string sound;

  DamagedCatalogue() {
    db::Store made = db::Store::create(store);
    for (const char* name : {"first", "second", "third"}) add_pass(made, name);
    made.back_up(folder / "backup");
    add_pass(made, "fourth");
    made = db::Store::open(folder / "backup");  // closes it
    sound = test::read_text(file);
  }
  void flip(std::size_t bit) {
    std::string bytes = sound;
    bytes[bit / 8] = char(bytes[bit / 8] ^ (1 << bit % 8));
    test::write_text(file, bytes);
  }
  std::size_t pages() const { return sound.size() / kPage; }
};

// One line for each frame: its scan, step, time and object.
std::vector<std::string> frames_of(const fs::path& folder) {
  const db::Store store = db::Store::open(folder);
  std::vector<std::string> lines;
  for (const db::Scan& scan : store.scans()) {
    for (const db::Frame& frame : store.frames(scan.id)) {
      lines.push_back(scan.name + " " + std::to_string(frame.step_index) + " " + std::to_string(frame.timestamp_ns) +
                      " " + frame.object.hex());
    }
  }
  return lines;
}

// What verification has to say, be it that the store cannot be opened.
std::vector<std::string> complaints(const fs::path& folder) {
  try {
    return db::Store::open(folder).verify().errors;
  } catch (const core::StoreError& error) {
    return {error.what()};
  }
}

}  // namespace

TEST_CASE_METHOD(DamagedCatalogue, "any flipped bit of the catalogue is found, in whatever page it is", "[long]") {
  REQUIRE(complaints(store).empty());
  std::mt19937 random(5);
  for (std::size_t page = 0; page < pages(); ++page) {
    for (int i = 0; i < 3; ++i) {
      const std::size_t bit = page * kPage * 8 + random() % (kPage * 8);
      CAPTURE(page, bit);
      flip(bit);
      CHECK_FALSE(complaints(store).empty());
    }
  }
  // All of the header, and its checksum at the page's end.
  for (std::size_t byte = 0; byte < 100; ++byte) {
    CAPTURE(byte);
    flip(byte * 8 + byte % 8);
    CHECK_FALSE(complaints(store).empty());
  }
  for (std::size_t byte = kPage - 8; byte < kPage; ++byte) {
    flip(byte * 8);
    CHECK_FALSE(complaints(store).empty());
  }
}

TEST_CASE_METHOD(DamagedCatalogue, "any flipped bit of the catalogue is put right without a backup", "[long]") {
  const std::vector<std::string> before = frames_of(store);
  std::mt19937 random(7);
  // One in every page at once; in the first page in its header and in what says where the first table's rows are.
  for (const std::size_t byte :
       {0,  3,  15, 16, 17, 18, 19, 20, 21, 23, 24,  28,  31,  35,  36,  40,  44,
        47, 52, 56, 59, 60, 63, 68, 92, 96, 99, 100, 101, 103, 104, 105, 108, int(kPage) - 3}) {
    CAPTURE(byte);
    std::string bytes = sound;
    for (std::size_t page = 0; page < pages(); ++page) {
      const std::size_t bit = page == 0 ? byte * 8 + byte % 8 : page * kPage * 8 + random() % (kPage * 8);
      bytes[bit / 8] = char(bytes[bit / 8] ^ (1 << bit % 8));
    }
    test::write_text(file, bytes);
    const db::CatalogueRepair report = db::Store::repair_catalogue(store, {}, false);
    CHECK(report.rows_dropped == 0);
    CHECK(frames_of(store) == before);
    CHECK(complaints(store).empty());
    fs::remove(report.damaged_copy);
  }
}

TEST_CASE_METHOD(DamagedCatalogue, "a header damaged in all that is known of it is put right without a backup") {
  const std::vector<std::string> before = frames_of(store);
  std::string bytes = sound;
  for (const std::size_t at : {0, 3, 16, 17, 18, 20, 21, 28, 29, 44, 56, 60, 61, 68, 70, 80})
    bytes[at] = char(~bytes[at]);
  test::write_text(file, bytes);
  db::Store::repair_catalogue(store, {}, false);
  CHECK(frames_of(store) == before);
  CHECK(complaints(store).empty());
}

TEST_CASE_METHOD(DamagedCatalogue, "frames whose rows were on a damaged page are named, the others verified") {
  const std::string hash = frames_of(store).front().substr(frames_of(store).front().size() - 32);
  // A row of table frames: the camera's name is not far before the object's.
  std::size_t row = sound.find(hash);
  while (std::string_view(sound).substr(row - 40, 40).find("main") == std::string_view::npos)
    row = sound.find(hash, row + 1);
  flip(row * 8);
  const auto errors = complaints(store);
  std::string all;
  for (const std::string& error : errors) all += error + "\n";
  CHECK_THAT(all, Contains("does not match its checksum"));
  CHECK_THAT(all, Contains("camera 'main': its row is on a page of the catalogue that does not match its checksum"));
  CHECK_THAT(all, !Contains("scan 'fourth'"));
}

TEST_CASE_METHOD(DamagedCatalogue, "a damaged page stays marked when it is written again, and is not backed up") {
  flip(8 * sound.find("fourtholat"));
  {
    db::Store damaged = db::Store::open(store);
    const db::Id id = damaged.scans().back().id;
    damaged.extend_scan(id, {{.step_index = kLights, .kind = db::StepKind::kDark}}, "{\"more\": 1}");
    CHECK_THAT(message_of([&] { damaged.back_up(folder / "spread"); }), Contains("nothing was copied"));
  }
  CHECK_THAT(complaints(store).front(), Contains("does not match its checksum"));
}

TEST_CASE_METHOD(DamagedCatalogue, "what another program wrote is kept until it is accepted") {
  SQLite::Database(file.string(), SQLite::OPEN_READWRITE).exec("UPDATE scans SET stage_key = 'elsewhere'");
  CHECK_THAT(complaints(store).front(), Contains("written by a program that is not lightstage"));
  CHECK_THAT(message_of([&] { db::Store::repair_catalogue(store, {}); }),
             Contains("--accept-catalogue takes it as it is"));
  CHECK(db::Store::repair_catalogue(store, {}, true).accepted);
  CHECK(complaints(store).empty());
  CHECK(db::Store::open(store).scan("first").stage_key == "elsewhere");
  CHECK_FALSE(db::Store::repair_catalogue(store, {}, true).accepted);
}

TEST_CASE_METHOD(DamagedCatalogue, "another program may look at a store that lies still") {
  {
    SQLite::Database look(file.string(), SQLite::OPEN_READWRITE);
    CHECK(look.execAndGet("SELECT count(*) FROM frames").getInt() == 4 * kLights);
  }
  CHECK(complaints(store).empty());
}

TEST_CASE_METHOD(DamagedCatalogue,
                 "repair makes a new catalogue of sound pages and of backups, and keeps the damaged one", "[long]") {
  const auto before = frames_of(store);
  for (std::size_t page = 0; page < pages(); ++page) {
    CAPTURE(page);
    for (const auto& entry : fs::directory_iterator(store)) {
      if (entry.path().filename().string().starts_with("store.sqlite.")) fs::remove(entry.path());
    }
    flip(page * kPage * 8 + 8 * 2000);
    const std::string damaged = test::read_text(file);
    const db::CatalogueRepair report = db::Store::repair_catalogue(store, {folder / "backup"});
    REQUIRE_FALSE(report.damaged_copy.empty());
    CHECK(test::read_text(report.damaged_copy) == damaged);
    // All that the backup has, and of the pass that it lacks what can be read.
    const auto now = frames_of(store);
    for (const std::string& line : now) CHECK(std::find(before.begin(), before.end(), line) != before.end());
    for (const std::string& line : before) {
      if (!line.starts_with("fourth")) CHECK(std::find(now.begin(), now.end(), line) != now.end());
    }
    for (const std::string& error : complaints(store)) CHECK_THAT(error, Contains("the frame is missing"));
    CHECK_THROWS_AS(db::Store::open(store).collect_garbage(std::chrono::seconds(0)), core::StoreError);
    CHECK(db::Store::repair_catalogue(store, {}).damaged_copy.empty());  // it is sound now
  }
}

TEST_CASE_METHOD(DamagedCatalogue, "without a backup repair keeps the rows of all sound pages", "[long]") {
  const auto before = frames_of(store);
  std::size_t most = 0;
  for (std::size_t page = 0; page < pages(); ++page) {
    CAPTURE(page);
    flip(page * kPage * 8 + 8 * (kPage - 1));
    try {
      db::Store::repair_catalogue(store, {});
    } catch (const core::StoreError& error) {
      // Whole but for the checksum: it is for the user to say.
      CHECK_THAT(error.what(), Contains("--accept-catalogue"));
    }
    most = std::max(most, frames_of(store).size());
    for (const std::string& line : frames_of(store))
      CHECK(std::find(before.begin(), before.end(), line) != before.end());
  }
  CHECK(most == before.size());  // where only an index was hit
}

TEST_CASE_METHOD(DamagedCatalogue, "what repair could not read is named until a backup has brought it back", "[long]") {
  db::Store::open(store).back_up(folder / "good");
  const auto before = frames_of(store);
  std::size_t losses = 0;
  for (std::size_t page = 1; page < pages(); ++page) {
    CAPTURE(page);
    for (const auto& entry : fs::directory_iterator(store)) {
      if (entry.path().filename().string().starts_with("store.sqlite.")) fs::remove(entry.path());
    }
    std::string bytes = sound;
    bytes.replace(page * kPage, 64, 64, '\xa5');  // where the page says what it holds
    test::write_text(file, bytes);
    db::CatalogueRepair report;
    try {
      report = db::Store::repair_catalogue(store, {});
    } catch (const core::StoreError& error) {  // where the tables are
      CHECK_THAT(error.what(), Contains("nothing of the catalogue can be read"));
      CHECK(db::Store::repair_catalogue(store, {folder / "good"}).made_anew);
      CHECK(frames_of(store) == before);
      continue;
    }
    REQUIRE(report.made_anew);
    const bool lost_some = frames_of(store) != before;
    losses += lost_some ? 1 : 0;
    if (lost_some) CHECK_FALSE(report.lost.empty());
    CHECK(db::Store::repair_catalogue(store, {}).lost == report.lost);
    const db::CatalogueRepair again = db::Store::repair_catalogue(store, {folder / "good"});
    CHECK(again.lost == std::vector<std::string>());
    CHECK((again.rows_from_backups > 0) == !report.lost.empty());
    CHECK(frames_of(store) == before);
    CHECK(complaints(store).empty());
  }
  CHECK(losses > 3);
}

TEST_CASE_METHOD(DamagedCatalogue, "a catalogue that is gone or no database comes back from a backup alone") {
  fs::remove(file);
  CHECK_THAT(message_of([&] { db::Store::repair_catalogue(store, {}); }), Contains("name a backup with --from"));
  CHECK_FALSE(fs::exists(file));
  test::write_text(file, std::string(10'000, 'x'));
  CHECK_THAT(message_of([&] { db::Store::repair_catalogue(store, {}); }), Contains("name a backup with --from"));
  CHECK(test::read_text(file) == std::string(10'000, 'x'));
  db::Store::repair_catalogue(store, {folder / "backup"});
  CHECK(frames_of(store).size() == 3 * kLights);
}

TEST_CASE_METHOD(DamagedCatalogue,
                 "nothing is repaired from the backup of another store, nor what is newer than the program") {
  { db::Store other = db::Store::create(folder / "other"); }
  flip(3 * kPage * 8);
  const std::string damaged = test::read_text(file);
  CHECK_THROWS_AS(db::Store::repair_catalogue(store, {folder / "other"}), core::UsageError);
  CHECK(test::read_text(file) == damaged);
  test::write_text(file, sound);
  SQLite::Database(file.string(), SQLite::OPEN_READWRITE).exec("PRAGMA user_version = 99");
  CHECK_THAT(message_of([&] { db::Store::repair_catalogue(store, {}); }), Contains("schema version 99"));
}
