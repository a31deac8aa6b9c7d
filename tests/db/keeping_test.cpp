// Backups, restoring, repair, removing what nothing refers to, and verification in parts.
#include <SQLiteCpp/SQLiteCpp.h>
#include <atomic>
#include <catch2/catch.hpp>
#include <csignal>
#include <thread>

#include "core/error.h"
#include "core/interrupt.h"
#include "db/scene.h"
#include "db/store.h"
#include "support/support.h"

using namespace lightstage;
using Catch::Matchers::Contains;
using Catch::Matchers::Equals;
using test::message_of;
namespace fs = std::filesystem;

namespace {

constexpr int kLights = 6;

void add_pass(db::Store& store, const std::string& name) {
  const db::Id scan_id = store.add_scan(test::olat_scan(name, kLights));
  for (int i = 0; i < kLights; ++i) {
    store.put_frame({.scan_id = scan_id, .camera = "main", .step_index = i},
                    test::half_pattern(9, 7, 3, int(scan_id) * 100 + i));
  }
}

struct Fixture {
  test::TemporaryFolder folder;
  db::Store store = db::Store::create(folder / "store");

  Fixture() {
    add_pass(store, "head");
    db::NewProduct mask;
    mask.kind = "mask";
    mask.scan_id = store.scan("head").id;
    mask.images = {{"mask", 0, store.put_object(test::half_pattern(9, 7, 1, 7)), 0}};
    store.add_product(mask);
  }
  fs::path object_of(std::size_t step) const {
    return store.object_path(store.frames(store.scan("head").id).at(step).object);
  }
  void flip_a_bit(const fs::path& file) const {
    std::string bytes = test::read_text(file);
    bytes[bytes.size() / 2] = char(bytes[bytes.size() / 2] ^ 4);
    test::write_text(file, bytes);
  }
};

std::map<std::string, std::string> objects_in(const fs::path& store) {
  std::map<std::string, std::string> files;
  for (const auto& [name, bytes] : test::snapshot(store / "objects")) {
    if (fs::is_regular_file(store / "objects" / name)) files[name] = bytes;
  }
  return files;
}

constexpr std::chrono::hours kDay{24};

}  // namespace

TEST_CASE_METHOD(Fixture, "a backup is the same store, and takes only what is new the next time") {
  const db::BackupReport first = store.back_up(folder / "backup");
  CHECK(first.objects == kLights + 1);
  CHECK(first.copied == kLights + 1);
  CHECK(first.copied_bytes > 0);
  CHECK(first.damaged.empty());
  CHECK(objects_in(folder / "backup") == objects_in(folder / "store"));
  {
    const db::Store backup = db::Store::open(folder / "backup");
    CHECK(backup.verify().errors == std::vector<std::string>());
    CHECK(backup.verify().notes == std::vector<std::string>());
    CHECK(backup.scan("head").steps.size() == kLights);
  }
  add_pass(store, "second");
  const db::BackupReport again = store.back_up(folder / "backup");
  CHECK(again.objects == 2 * kLights + 1);
  CHECK(again.copied == kLights);
  CHECK(db::Store::open(folder / "backup").scan("second").steps.size() == kLights);
  CHECK(store.back_up(folder / "backup").copied == 0);
}

TEST_CASE_METHOD(Fixture, "models that the store keeps are backed up too") {
  fs::create_directory(folder / "store/models");
  test::write_text(folder / "store/models/a.safetensors", "first");
  store.back_up(folder / "backup");
  CHECK(test::read_text(folder / "backup/models/a.safetensors") == "first");
  test::write_text(folder / "store/models/a.safetensors", "second model");
  store.back_up(folder / "backup");
  CHECK(test::read_text(folder / "backup/models/a.safetensors") == "second model");
}

TEST_CASE_METHOD(Fixture, "models are not written through links that lie in a backup") {
  fs::create_directory(folder / "store/models");
  test::write_text(folder / "store/models/a.safetensors", "a model");
  store.back_up(folder / "backup");
  test::write_text(folder / "thesis.txt", "mine");
  fs::remove(folder / "backup/models/a.safetensors");
  fs::create_symlink(folder / "thesis.txt", folder / "backup/models/a.safetensors");
  CHECK_THAT(message_of([&] { store.back_up(folder / "backup"); }), Contains("leads out of the folder"));
  CHECK(test::read_text(folder / "thesis.txt") == "mine");
}

TEST_CASE_METHOD(Fixture, "a backup does not go into the store itself nor into another one") {
  CHECK_THAT(message_of([&] { store.back_up(folder / "store"); }), Contains("this is the store itself"));
  { db::Store other = db::Store::create(folder / "other"); }
  const auto before = test::snapshot(folder / "other");
  CHECK_THROWS_AS(store.back_up(folder / "other"), core::UsageError);
  CHECK_THAT(message_of([&] { store.back_up(folder / "other"); }), Contains("another store"));
  CHECK(test::snapshot(folder / "other") == before);
}

TEST_CASE_METHOD(Fixture, "a damaged object does not spoil the sound copy that a backup holds") {
  store.back_up(folder / "backup");
  const auto sound = objects_in(folder / "backup");
  flip_a_bit(object_of(2));
  CHECK(store.back_up(folder / "backup").damaged.empty());  // it lacks nothing
  CHECK(objects_in(folder / "backup") == sound);

  const db::BackupReport elsewhere = store.back_up(folder / "late");
  REQUIRE(elsewhere.damaged.size() == 1);
  CHECK_THAT(elsewhere.damaged[0], Contains("scan 'head', step 2, camera 'main': object") && Contains("is damaged"));
  CHECK(elsewhere.copied == kLights);
}

TEST_CASE_METHOD(Fixture, "a restored store has everything, and can be backed up to where it came from") {
  store.back_up(folder / "backup");
  db::Store::restore(folder / "backup", folder / "again");
  const db::Store again = db::Store::open(folder / "again");
  CHECK(again.verify().errors == std::vector<std::string>());
  CHECK(objects_in(folder / "again") == objects_in(folder / "store"));
  CHECK(again.newest_product("mask", again.scan("head").id).has_value());
  CHECK(again.back_up(folder / "backup").copied == 0);
  CHECK_THROWS_AS(db::Store::restore(folder / "backup", folder / "again"), core::UsageError);
  test::write_text(folder / "file", "no folder");
  for (const fs::path& nothing : {folder / "nowhere", folder / "file"}) {
    CHECK_THAT(message_of([&] { db::Store::restore(nothing, folder / "new"); }),
               Contains(nothing.string() + ": there is no backup here") && !Contains("init"));
  }
}

TEST_CASE_METHOD(Fixture, "the log of a catalogue that is gone is not taken for that of a new one") {
  store.back_up(folder / "backup");
  fs::create_directories(folder / "again/objects");
  test::write_text(folder / "again/store.sqlite-wal", "what a crash left");
  CHECK_THAT(message_of([&] { db::Store::restore(folder / "backup", folder / "again"); }),
             Contains("move it to another folder"));
  fs::create_directory(folder / "new");
  test::write_text(folder / "new/store.sqlite-wal", "what a crash left");
  CHECK_THAT(message_of([&] { db::Store::create(folder / "new"); }), Contains("move it to another folder"));
  CHECK_FALSE(fs::exists(folder / "again/store.sqlite"));
}

TEST_CASE_METHOD(Fixture, "an interrupted backup leaves the earlier one whole, and goes on") {
  store.back_up(folder / "backup");
  add_pass(store, "second");
  // A file where an object's folder belongs: copying fails there, as it does on a full disk.
  fs::path blocked;
  for (const db::Frame& frame : store.frames(store.scan("second").id)) {
    const fs::path object = fs::relative(store.object_path(frame.object), folder / "store/objects");
    blocked = folder / "backup/objects" / object.parent_path();
    if (!fs::exists(blocked)) break;
  }
  test::write_text(blocked, "in the way");
  CHECK_THROWS_AS(store.back_up(folder / "backup"), core::StoreError);
  {
    const db::Store backup = db::Store::open(folder / "backup");
    CHECK_FALSE(backup.find_scan("second"));
    const std::vector<std::string> errors = backup.verify().errors;
    REQUIRE(errors.size() == 1);
    CHECK_THAT(errors[0], Contains(blocked.string() + ": is a file"));
  }
  fs::remove(blocked);
  store.back_up(folder / "backup");
  CHECK(db::Store::open(folder / "backup").verify().errors == std::vector<std::string>());
  CHECK(objects_in(folder / "backup") == objects_in(folder / "store"));
}

TEST_CASE_METHOD(Fixture, "a store that is written to meanwhile gives a whole backup") {
  std::thread writer([&] {
    db::Store other = db::Store::open(folder / "store");
    for (int i = 0; i < 4; ++i) add_pass(other, "pass" + std::to_string(i));
  });
  for (int i = 0; i < 5; ++i) {
    store.back_up(folder / "backup");
    const db::VerifyReport report = db::Store::open(folder / "backup").verify();
    // A pass may be caught in the middle; what was acknowledged is there.
    for (const std::string& error : report.errors) CHECK_THAT(error, Contains("the frame is missing"));
  }
  writer.join();
  store.back_up(folder / "backup");
  CHECK(db::Store::open(folder / "backup").verify().errors == std::vector<std::string>());
}

TEST_CASE_METHOD(Fixture, "a store that is moved while it is in use is not cut in two") {
  const fs::path here = folder / "store", there = folder / "moved";
  const db::Id scan_id = store.add_scan(test::olat_scan("second", 3));
  const auto frame = [&](int step) { return db::NewFrame{.scan_id = scan_id, .camera = "main", .step_index = step}; };
  const auto picture = [](int step) { return test::half_pattern(9, 7, 3, 300 + step); };
  store.put_frame(frame(0), picture(0));
  store.back_up(folder / "backup");
  std::vector<db::UnsyncedFrame> begun;
  begun.push_back(store.begin_frame(frame(1), picture(1)));
  fs::rename(here, there);
  CHECK_THAT(message_of([&] { store.begin_frame(frame(2), picture(2)); }), Contains("the store was moved"));
  CHECK_THROWS_AS(store.finish_frames(std::move(begun)), core::StoreError);
  CHECK_FALSE(fs::exists(here));

  // Another one in its place, even of the same content.
  db::Store::restore(folder / "backup", here);
  const auto objects = objects_in(there);
  CHECK_THAT(message_of([&] { store.put_frame(frame(2), picture(2)); }),
             Contains("moved or replaced while it was in use"));
  CHECK_THAT(message_of([&] { store.remove_scan(scan_id); }), Contains("moved or replaced"));
  CHECK_THAT(message_of([&] { store.collect_garbage(std::chrono::seconds(0)); }), Contains("moved or replaced"));
  CHECK(objects_in(there) == objects);
  for (const fs::path& place : {here, there}) {
    CHECK(db::Store::open(place).frames(scan_id).size() == 1);
  }
}

TEST_CASE_METHOD(Fixture, "repair mends from backups and from what interrupted writes left, and nothing else changes") {
  store.back_up(folder / "backup");
  const auto sound = objects_in(folder / "store");
  CHECK(store.repair({}).mended.empty());
  flip_a_bit(object_of(0));
  fs::resize_file(object_of(1), 10);
  fs::remove(object_of(2));
  fs::rename(object_of(3), folder / "store/objects/incoming-1-2.exr");

  db::RepairReport report = store.repair({});
  REQUIRE(report.mended.size() == 1);
  CHECK_THAT(report.mended[0], Contains("scan 'head', step 3, camera 'main'") && Contains("is missing"));
  REQUIRE(report.lost.size() == 3);
  CHECK(fs::file_size(object_of(1)) == 10);  // what is left of it stays

  report = store.repair({folder / "backup"});
  CHECK(report.mended.size() == 3);
  CHECK(report.lost.empty());
  CHECK(store.verify().errors == std::vector<std::string>());
  fs::remove(folder / "store/objects/incoming-1-2.exr");
  CHECK(objects_in(folder / "store") == sound);
}

TEST_CASE_METHOD(Fixture, "repair takes nothing from a damaged backup") {
  store.back_up(folder / "backup");
  const fs::path copy = folder / "backup/objects" / fs::relative(object_of(4), folder / "store/objects");
  flip_a_bit(copy);
  fs::remove(object_of(4));
  const db::RepairReport report = store.repair({folder / "backup"});
  CHECK(report.mended.empty());
  CHECK(report.lost.size() == 1);
  CHECK_FALSE(fs::exists(object_of(4)));
  CHECK_THROWS_AS(store.repair({folder / "nowhere"}), core::UsageError);
}

TEST_CASE_METHOD(Fixture, "only what nothing refers to is removed, and only when it is old") {
  const auto before = objects_in(folder / "store");
  const db::ContentHash orphan = store.put_object(test::half_pattern(30, 30, 3, 99));
  test::write_text(folder / "store/objects/incoming-3-4.exr", "half written");

  db::GarbageReport report = store.collect_garbage(kDay);
  CHECK(report.objects == 0);
  CHECK(report.files == 0);
  CHECK(report.kept_young == 2);
  report = store.collect_garbage(std::chrono::seconds(0), true);
  CHECK(report.objects == 1);
  CHECK(report.files == 1);
  CHECK(fs::exists(store.object_path(orphan)));

  const auto old = fs::file_time_type::clock::now() - 2 * kDay;
  for (const auto& [name, bytes] : objects_in(folder / "store"))
    fs::last_write_time(folder / "store/objects" / name, old);
  report = store.collect_garbage(kDay);
  CHECK(report.objects == 1);
  CHECK(report.files == 1);
  CHECK(report.bytes > 0);
  CHECK(objects_in(folder / "store") == before);
  CHECK(store.verify().notes == std::vector<std::string>());
}

TEST_CASE_METHOD(Fixture, "an object that is stored again is young again") {
  const db::ContentHash orphan = store.put_object(test::half_pattern(30, 30, 3, 99));
  fs::last_write_time(store.object_path(orphan), fs::file_time_type::clock::now() - 2 * kDay);
  CHECK(store.put_object(test::half_pattern(30, 30, 3, 99)) == orphan);
  CHECK(store.collect_garbage(kDay).objects == 0);
}

TEST_CASE_METHOD(Fixture, "objects of a removed scan go, those that others share stay") {
  add_pass(store, "second");
  const auto kept = objects_in(folder / "store");
  db::NewScan third = test::olat_scan("third", 2);
  const db::Id id = store.add_scan(third);
  store.put_frame({.scan_id = id, .camera = "main", .step_index = 0}, test::half_pattern(9, 7, 3, 5000));
  store.add_frame({.scan_id = id, .camera = "main", .step_index = 1}, store.frames(store.scan("second").id)[0].object);
  store.remove_scan(id);
  CHECK(store.collect_garbage(std::chrono::seconds(0)).objects == 1);
  CHECK(objects_in(folder / "store") == kept);
}

TEST_CASE_METHOD(Fixture, "single scans are verified by themselves") {
  add_pass(store, "second");
  flip_a_bit(object_of(5));
  CHECK(store.verify({.scans = {"second"}}).errors.empty());
  const db::VerifyReport head = store.verify({.scans = {"head"}});
  CHECK(head.errors.size() == 1);
  CHECK(head.frames == kLights);
  CHECK(head.objects == kLights + 1);
  CHECK_THROWS_AS(store.verify({.scans = {"nobody"}}), core::UsageError);
}

namespace {

// What verify.json holds when a verification of everything is interrupted by Ctrl-C after its first scan.
std::string interrupted_verification(const fs::path& folder) {
  auto guard = std::make_unique<core::InterruptGuard>();
  const db::Store store = db::Store::open(folder);
  std::atomic<bool> done = false;
  std::thread user([&] {
    while (!done && !fs::exists(folder / "verify.json")) std::this_thread::sleep_for(std::chrono::microseconds(50));
    std::raise(SIGINT);
  });
  // Nothing where it was quicker.
  std::string state;
  try {
    store.verify();
  } catch (const core::Interrupted&) {
    if (fs::exists(folder / "verify.json")) state = test::read_text(folder / "verify.json");
  }
  done = true;
  user.join();
  guard.reset();
  guard = std::make_unique<core::InterruptGuard>();  // forgets the signal
  return state;
}

}  // namespace

TEST_CASE_METHOD(Fixture, "a verification goes on after the scans that were found sound") {
  for (const char* name : {"second", "third", "fourth", "fifth"}) add_pass(store, name);
  flip_a_bit(object_of(5));  // of the first
  const db::VerifyReport whole = store.verify();
  REQUIRE(whole.errors.size() == 1);
  std::string state;
  while (state.empty()) state = interrupted_verification(folder / "store");
  const auto resume_from = [&](const std::string& text) {
    test::write_text(folder / "store/verify.json", text);
    const db::VerifyReport resumed = store.verify({.resume = true});
    CHECK_FALSE(fs::exists(folder / "store/verify.json"));
    return resumed;
  };
  db::VerifyReport resumed = resume_from(state);
  CHECK(resumed.scans_done_before >= 1);
  CHECK(resumed.errors == whole.errors);  // found anew
  CHECK(resumed.frames == whole.frames);
  CHECK(resumed.objects == whole.objects);
  CHECK(resumed.notes == whole.notes);

  // What a lie describes is read.
  std::string lie = state;
  lie.replace(lie.find("contents\": \"") + 12, 4, "ffff");
  CHECK(resume_from(lie).scans_done_before == resumed.scans_done_before - 1);

  // What has come to a sound scan since was not read.
  const std::size_t done = resumed.scans_done_before;
  db::NewProduct mask;
  mask.kind = "mask";
  mask.scan_id = store.scan("second").id;
  const db::ContentHash object = store.put_object(test::half_pattern(9, 7, 1, 77));
  mask.images = {{"mask", 0, object, 0}};
  store.add_product(mask);
  flip_a_bit(store.object_path(object));
  resumed = resume_from(state);
  CHECK(resumed.scans_done_before == done - 1);
  REQUIRE(resumed.errors.size() == 2);
  CHECK_THAT(resumed.errors[1], Contains("image 'mask' 0: object " + object.hex() + " is damaged"));

  // A state of another store, a damaged one and one of an earlier program only mean to start anew.
  std::string other = state;
  other.replace(other.find("store\": \"") + 9, 4, "0000");
  CHECK(resume_from(other).scans_done_before == 0);
  for (const char* text : {"{\"scans_done\": [1], \"frames\": 18446744073709551615, \"errors\": [\"a\\nb\"]}",
                           "{\"store\": \"", "[]", "{\"store\": \"x\", \"sound\": [{\"scan\": 1}]}"}) {
    resumed = resume_from(text);
    CHECK(resumed.scans_done_before == 0);
    CHECK(resumed.frames == whole.frames);
    CHECK(resumed.errors.size() == 2);
  }
}

TEST_CASE_METHOD(Fixture, "every owner of a damaged object is named") {
  const db::Id id = store.add_scan(test::olat_scan("second", 1));
  store.add_frame({.scan_id = id, .camera = "main", .step_index = 0}, store.frames(store.scan("head").id)[1].object);
  flip_a_bit(object_of(1));
  const auto errors = store.verify().errors;
  REQUIRE(errors.size() == 2);
  CHECK_THAT(errors[0], Contains("scan 'head', step 1"));
  CHECK_THAT(errors[1], Contains("scan 'second', step 0"));
}

TEST_CASE("counts of scans are those of their rows") {
  const test::TemporaryFolder folder;
  db::Store store = db::Store::create(folder / "store");
  CHECK(store.scan_summaries().empty());
  add_pass(store, "head");
  store.add_scan(test::olat_scan("empty", 3));
  const auto summaries = store.scan_summaries();
  REQUIRE(summaries.size() == 2);
  CHECK(summaries[0].name == "head");
  CHECK(summaries[0].steps == kLights);
  CHECK(summaries[0].frames == kLights);
  CHECK(summaries[1].frames == 0);
  CHECK(summaries[1].steps == 3);
  CHECK(summaries[1].cameras == std::vector<std::string>{"main"});
}
