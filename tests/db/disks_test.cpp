// Stores on disks that are full, and on such as only can be read.
#include <catch2/catch.hpp>
#include <filesystem>

#include "core/parallel.h"
#include "db/scan_loader.h"
#include "db/scene.h"
#include "db/store.h"
#include "support/small_disk.h"
#include "support/support.h"

using namespace lightstage;
using Catch::Matchers::Contains;
using test::message_of;
namespace fs = std::filesystem;

namespace {

struct Disk {
  explicit Disk(std::size_t megabytes) : disk((fs::create_directory(folder / "disk"), folder / "disk"), megabytes) {
    if (!disk.problem().empty()) return;
    core::set_thread_count(1);  // threads of earlier tests do not see the disk
    db::Store store = db::Store::create(path);
    add_pass(store, "head");
  }
  ~Disk() { core::set_thread_count(0); }
  Disk(const Disk&) = delete;
  Disk& operator=(const Disk&) = delete;

  static void add_pass(db::Store& store, const std::string& name) {
    const db::Id id = store.add_scan(test::olat_scan(name, 3));
    for (int i = 0; i < 3; ++i) {
      store.put_frame({.scan_id = id, .camera = "main", .step_index = i},
                      test::half_pattern(40, 50, 3, int(id) * 10 + i));
    }
  }

  test::TemporaryFolder folder;
  test::SmallDisk disk;
  fs::path path = folder / "disk/a store? 100%";
};

}  // namespace

TEST_CASE("a store on a disk that is mounted read-only is read, verified, backed up and restored from") {
  const Disk disk(8);
  if (!disk.disk.problem().empty()) SKIP_TEST(disk.disk.problem());
  REQUIRE(disk.disk.make_read_only());
  const auto before = test::snapshot(disk.path);
  {
    db::Store store = db::Store::open(disk.path);
    store.require_sound_catalogue();
    CHECK(store.scan_summaries().size() == 1);
    CHECK(store.object(store.frames(1)[2].object).height() == 40);
    CHECK(store.verify().errors == std::vector<std::string>());
    CHECK(store.back_up(disk.folder / "backup").copied == 3);
    db::Store::restore(disk.path, disk.folder / "again");
    CHECK(db::Store::open(disk.folder / "again").repair({disk.path}).lost.empty());
    db::Store twin = db::Store::open(disk.path);
    CHECK(twin.frames(1).size() == 3);

    const std::string expected = "mounted read-only";
    CHECK_THAT(message_of([&] { store.require_writable(); }), Contains(expected));
    CHECK_THAT(message_of([&] { store.remove_scan(1); }), Contains(expected));
    CHECK_THAT(message_of([&] { store.collect_garbage(std::chrono::seconds(0)); }), Contains(expected));
    CHECK_THAT(message_of([&] { store.repair({}); }), Contains(expected));
    CHECK_THAT(message_of([&] { db::Store::open(disk.folder / "again").back_up(disk.path); }), Contains(expected));
  }
  CHECK(test::snapshot(disk.path) == before);
}

TEST_CASE("on a disk that is mounted read-only the log of a crash is read where it can be, and otherwise named") {
  const Disk disk(8);
  if (!disk.disk.problem().empty()) SKIP_TEST(disk.disk.problem());
  const fs::path log = disk.path / "store.sqlite-wal", index = disk.path / "store.sqlite-shm";
  {
    // As a crash leaves it: catalogue, log and index as they are while a program is at work.
    db::Store store = db::Store::open(disk.path);
    Disk::add_pass(store, "second");
    fs::copy(disk.path, disk.folder / "disk/crashed", fs::copy_options::recursive);
  }
  fs::remove_all(disk.path);
  fs::rename(disk.folder / "disk/crashed", disk.path);
  REQUIRE(fs::file_size(log) > 0);
  REQUIRE(fs::exists(index));
  SECTION("with its index") {
    REQUIRE(disk.disk.make_read_only());
    const db::Store store = db::Store::open(disk.path);
    CHECK(store.scan("second").steps.size() == 3);
    CHECK(store.verify().errors == std::vector<std::string>());
  }
  SECTION("without") {
    fs::remove(index);
    REQUIRE(disk.disk.make_read_only());
    CHECK_THAT(message_of([&] { db::Store::open(disk.path); }),
               Contains(log.string()) && Contains("mount it for writing once"));
  }
}

TEST_CASE("a store on a full disk is read and verified, and removing what nobody needs makes room") {
  const Disk disk(8);
  if (!disk.disk.problem().empty()) SKIP_TEST(disk.disk.problem());
  {
    db::Store store = db::Store::open(disk.path);
    Disk::add_pass(store, "second");
    store.remove_scan(store.scan("second").id);
  }
  disk.disk.fill("ballast");
  {
    db::Store store = db::Store::open(disk.path);
    CHECK(store.scan_summaries().size() == 1);
    CHECK(store.verify().errors == std::vector<std::string>());
    CHECK_THAT(message_of([&] { Disk::add_pass(store, "third"); }), Contains("disk is full"));
    CHECK(store.collect_garbage(std::chrono::seconds(0)).objects == 3);
  }
  CHECK(fs::space(disk.path).available > 0);
  const db::Store store = db::Store::open(disk.path);
  CHECK(store.verify().errors == std::vector<std::string>());
  CHECK(store.verify().notes == std::vector<std::string>());
}
