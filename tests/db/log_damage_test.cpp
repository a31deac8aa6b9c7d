// Flipped bits in the write-ahead log that a crash has left: found before SQLite cuts the log there, and mended.
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

constexpr int kFrames = 12;
constexpr std::size_t kHeader = 32, kPage = 24 + 4096;

// What a crash leaves of a store in use: a catalogue, and a log of one transaction for the scan and one for each frame.
struct CrashedStore {
  test::TemporaryFolder folder;
  fs::path left = folder / "left", log = left / "store.sqlite-wal";
  std::string catalogue, sound;  // the bytes of both files

  // `begun_anew`: the log was folded in before, and old pages lie behind the new ones.
  explicit CrashedStore(bool begun_anew = false) {
    db::Store store = db::Store::create(folder / "store");
    if (begun_anew) store.add_scan(test::olat_scan("old", 45'000));  // which is more than the log holds
    const db::Id id = store.add_scan(test::olat_scan("head", kFrames));
    for (int i = 0; i < kFrames; ++i) {
      store.put_frame({.scan_id = id, .camera = "main", .step_index = i}, test::half_pattern(3, 3, 3, i));
    }
    fs::create_directory(left);
    fs::copy(folder / "store/objects", left / "objects", fs::copy_options::recursive);
    catalogue = test::read_text(folder / "store/store.sqlite");
    sound = test::read_text(folder / "store/store.sqlite-wal");
  }
  void leave(const std::string& bytes) const {
    for (const auto& entry : fs::directory_iterator(left)) {
      if (entry.path().filename() != "objects") fs::remove(entry.path());
    }
    test::write_text(left / "store.sqlite", catalogue);
    test::write_text(log, bytes);
  }
  std::size_t frames() const {
    const db::Store store = db::Store::open(left);
    const auto scan = store.find_scan("head");
    return scan ? store.frames(scan->id).size() : 0;
  }
  // Every row of it.
  std::string contents() const {
    const db::Store store = db::Store::open(left);
    std::string text;
    for (const db::Scan& scan : store.scans()) {
      text += scan.name + " " + std::to_string(scan.steps.size()) + "\n";
      for (const db::Frame& frame : store.frames(scan.id)) {
        text += std::to_string(frame.step_index) + " " + frame.camera + " " + frame.object.hex() + " " +
                std::to_string(frame.attempt) + "\n";
      }
    }
    CHECK(SQLite::Database((left / "store.sqlite").string()).execAndGet("PRAGMA integrity_check").getString() == "ok");
    return text;
  }
  // Pages of the log that are of its present run, and where the last of its transactions begins.
  std::size_t pages() const {
    std::size_t count = 0;
    while (kHeader + (count + 1) * kPage <= sound.size() && sound.substr(16, 8) == sound.substr(at(count) + 8, 8))
      ++count;
    return count;
  }
  std::size_t last_transaction() const {
    std::size_t page = pages() - 1;
    while (page > 0 && sound.substr(at(page - 1) + 4, 4) == std::string(4, '\0')) --page;
    return page;
  }
  static std::size_t at(std::size_t page) { return kHeader + page * kPage; }
};

std::string flipped(std::string bytes, std::size_t bit) {
  bytes[bit / 8] = char(bytes[bit / 8] ^ (1 << bit % 8));
  return bytes;
}

}  // namespace

TEST_CASE("a sound log is taken as it is, also one that was begun anew, and one that ends anywhere") {
  const CrashedStore crashed(GENERATE(false, true));
  REQUIRE(crashed.pages() > kFrames);
  crashed.leave(crashed.sound);
  CHECK(crashed.frames() == kFrames);
  for (const std::string& error : db::Store::open(crashed.left).verify().errors) {
    CHECK_THAT(error, Contains("scan 'old'") && Contains("the frame is missing"));
  }
  std::mt19937 random(7);
  for (int i = 0; i < 30; ++i) {
    crashed.leave(crashed.sound.substr(0, random() % crashed.sound.size()));
    CHECK(crashed.frames() <= kFrames);
  }
}

TEST_CASE("any flipped bit of a log stops everything but repair, which puts it right where the checksums tell it",
          "[long]") {
  const bool begun_anew = GENERATE(false, true);
  const CrashedStore crashed(begun_anew);
  std::mt19937 random(11);
  std::vector<std::size_t> bits;
  for (std::size_t bit = 0; bit < 8 * kHeader; bit += begun_anew ? 31 : 5) bits.push_back(bit);  // of its header
  for (std::size_t page = 0; page < crashed.pages(); page += page < 5 ? 1 : begun_anew ? 400 : 4) {
    const std::size_t first = 8 * CrashedStore::at(page);
    bits.push_back(first + random() % (8 * 24));
    bits.push_back(first + 8 * 24 + random() % (8 * 4096));
    bits.push_back(first + 8 * 24 + 8 * 4096 - 1 - random() % 64);  // which the checksum may have in itself, too
  }
  crashed.leave(crashed.sound);
  const std::string all = crashed.contents();
  std::size_t mended = 0;
  for (const std::size_t bit : bits) {
    CAPTURE(bit);
    const std::string damaged = flipped(crashed.sound, bit);
    crashed.leave(damaged);
    const std::string refusal = message_of([&] { db::Store::open(crashed.left); });
    REQUIRE_THAT(refusal, Contains("this log, which a crash has left, is damaged") && Contains("store repair"));
    REQUIRE(test::read_text(crashed.log) == damaged);
    const db::CatalogueRepair repair = db::Store::repair_catalogue(crashed.left, {});
    CHECK(repair.damaged_copy.empty());
    CHECK(test::read_text(repair.log_copy) == damaged);
    if (repair.log_pages_lost > 0) {  // one of several bits that the checksums cannot tell apart
      CHECK(crashed.frames() < kFrames);
      continue;
    }
    ++mended;
    CHECK(repair.log_bits == 1);
    REQUIRE(crashed.contents() == all);
  }
  CAPTURE(mended, bits.size());
  CHECK(double(mended) > 0.7 * double(bits.size()));
  db::Store store = db::Store::open(crashed.left);
  CHECK_THAT(message_of([&] { store.collect_garbage(std::chrono::seconds(0)); }),
             Contains("store.sqlite-wal.damaged-1"));
}

TEST_CASE("a bit in each of several pages is put right") {
  const CrashedStore crashed;
  std::string damaged = crashed.sound;
  // Not of the highest bits.
  for (std::size_t page = 1; page < crashed.pages(); page += 4) {
    damaged = flipped(damaged, 8 * (CrashedStore::at(page) + 24 + 700) + page % 8);
  }
  crashed.leave(damaged);
  CHECK(db::Store::repair_catalogue(crashed.left, {}).log_bits > 1);
  CHECK(crashed.frames() == kFrames);
}

TEST_CASE("a log that cannot be mended is cut after its last sound transaction, and kept beside it") {
  const CrashedStore crashed;
  for (const std::size_t page : {std::size_t(1), crashed.pages() / 2, crashed.last_transaction() - 1}) {
    CAPTURE(page);
    std::string damaged = crashed.sound;
    damaged.replace(CrashedStore::at(page) + 1000, 512, std::string(512, 'x'));
    crashed.leave(damaged);
    CHECK_THAT(message_of([&] { db::Store::open(crashed.left); }),
               Contains("is damaged at page " + std::to_string(page + 1)));
    const db::CatalogueRepair repair = db::Store::repair_catalogue(crashed.left, {});
    CHECK(repair.log_bits == 0);
    CHECK(repair.log_pages_lost >= crashed.pages() - page);
    CHECK(test::read_text(repair.log_copy) == damaged);
    CHECK(crashed.frames() < kFrames);
  }
}

TEST_CASE("a header of which nothing can be made is told of, and the log kept") {
  const CrashedStore crashed;
  std::string damaged = crashed.sound;
  damaged.replace(0, kHeader, std::string(kHeader, 'x'));
  crashed.leave(damaged);
  CHECK_THAT(message_of([&] { db::Store::open(crashed.left); }), Contains("is damaged in its header"));
  const db::CatalogueRepair repair = db::Store::repair_catalogue(crashed.left, {});
  CHECK(repair.log_pages_lost == crashed.pages());
  CHECK(fs::file_size(repair.log_copy) == damaged.size());
  CHECK(crashed.frames() == 0);
}

TEST_CASE("a last transaction that came to the disk in parts is no damage, and only it is lost") {
  const CrashedStore crashed(GENERATE(false, true));
  const std::size_t first = crashed.last_transaction(), last = crashed.pages();
  REQUIRE(last - first > 1);
  std::mt19937 random(3);
  for (int i = 0; i < 60; ++i) {
    CAPTURE(i);
    // What was there before, for some sectors of it.
    std::string torn = crashed.sound;
    bool any = false;
    for (std::size_t at = CrashedStore::at(first); at < CrashedStore::at(last);) {
      const std::size_t end = std::min((at / 512 + 1) * 512, CrashedStore::at(last));
      if (random() % 3 == 0) {
        torn.replace(at, end - at, std::string(end - at, i % 2 == 0 ? '\0' : char(random())));
        any = true;
      }
      at = end;
    }
    if (!any) continue;
    crashed.leave(torn);
    REQUIRE(crashed.frames() == kFrames - 1);
  }
}

TEST_CASE("a damaged log is not repaired while another has the store open") {
  const CrashedStore crashed;
  crashed.leave(crashed.sound);
  SQLite::Database other((crashed.left / "store.sqlite").string(), SQLite::OPEN_READWRITE);
  REQUIRE(other.execAndGet("SELECT count(*) FROM frames").getInt() == kFrames);
  test::write_text(crashed.log, flipped(crashed.sound, 8 * (kHeader + 500)));
  CHECK_THAT(message_of([&] { db::Store::repair_catalogue(crashed.left, {}); }),
             Contains("another program has the store open"));
}
