// `store verify|backup|restore|repair|gc` as a user types them.
#include <catch2/catch.hpp>
#include <fstream>

#include "cli/darkroom.h"
#include "cli/program.h"
#include "db/store.h"
#include "support/support.h"

using namespace lightstage;
using Catch::Matchers::Contains;
using test::run_program;
namespace fs = std::filesystem;

namespace {

void flip_a_bit(const fs::path& file) {
  std::fstream stream(file, std::ios::binary | std::ios::in | std::ios::out);
  stream.seekp(40);
  stream.put('\x7f');
}

fs::path object_of(const fs::path& store_folder, const std::string& scan, std::size_t step) {
  const db::Store store = db::Store::open(store_folder);
  return store.object_path(store.frames(store.scan(scan).id).at(step).object);
}

}  // namespace

TEST_CASE("a damaged store is named, mended from its backup, and restored from it") {
  const test::Darkroom darkroom;
  const fs::path store = darkroom.store(), backup = darkroom / "backup";
  const auto backed_up = run_program(store, {"store", "backup", backup.string(), "--json"});
  INFO(backed_up.err);
  REQUIRE(backed_up.status == 0);
  CHECK(backed_up.json()["copied"].get<int>() > 0);
  CHECK(run_program(store, {"store", "backup", backup.string(), "--json"}).json()["copied"] == 0);

  flip_a_bit(object_of(store, "ball", 3));
  const auto found = run_program(store, {"store", "verify", "ball"});
  CHECK(found.status == 5);
  CHECK_THAT(found.out, Contains("scan 'ball', step 3, camera") && Contains("is damaged"));
  const auto without = run_program(store, {"store", "repair"});
  CHECK(without.status == 5);
  CHECK_THAT(without.err, Contains("no sound copy of 1 object; name backups with --from"));
  const auto mended = run_program(store, {"store", "repair", "--from", backup.string(), "--json"});
  CHECK(mended.status == 0);
  CHECK(mended.json()["mended"].size() == 1);
  CHECK(run_program(store, {"store", "verify"}).status == 0);

  const fs::path again = darkroom / "again";
  CHECK(run_program(again, {"store", "restore", backup.string()}).status == 0);
  CHECK(run_program(again, {"store", "verify", "--json"}).json()["ok"] == true);
  const auto refused = run_program(again, {"store", "restore", backup.string()});
  CHECK(refused.status == 2);
  CHECK_THAT(refused.err, Contains("there is a store already"));
}

TEST_CASE("a removed scan is brought back from the backup") {
  const test::Darkroom darkroom;
  const fs::path store = darkroom.store(), backup = darkroom / "backup";
  REQUIRE(run_program(store, {"store", "backup", backup.string()}).status == 0);
  REQUIRE(run_program(store, {"store", "rm", "ball", "--yes"}).status == 0);
  const auto again = run_program(store, {"store", "backup", backup.string(), "--json"});
  CHECK(again.status == 0);
  CHECK_THAT(again.json()["gone"].dump(), Contains("scan 'ball' as a whole: 24 frames"));
  const std::string kept = again.json()["kept_catalogue"];
  REQUIRE(run_program(store, {"store", "gc", "--older-than", "0"}).status == 0);
  const auto back = run_program(store, {"store", "repair", "--from", kept, "--json"});
  INFO(back.err);
  CHECK(back.status == 0);
  CHECK(back.json()["mended"].size() >= 24);
  CHECK(run_program(store, {"store", "ls", "--json"}).json()["scans"][0]["frames"] == 24);
  CHECK(run_program(store, {"store", "verify"}).status == 0);
}

TEST_CASE("copies go to folders of their own, and a lost catalogue is not replaced by an empty one") {
  const test::Darkroom darkroom;
  const fs::path store = darkroom.store();
  for (const std::string& folder : {std::string(), (store / "objects").string(), (store / "objects/ab").string()}) {
    const auto refused = run_program(store, {"store", "backup", folder});
    CHECK(refused.status == 2);
    CHECK_THAT(refused.err, !Contains(": cannot"));
  }
  fs::remove(store / "store.sqlite");
  const auto lost = run_program(store, {"store", "ls"});
  CHECK(lost.status == 5);
  CHECK_THAT(lost.err, Contains("store repair --store " + store.string() + " --from BACKUP"));
  CHECK(run_program(store, {"init"}).status == 2);
  CHECK_FALSE(fs::exists(store / "store.sqlite"));
}

TEST_CASE("gc removes what a removed scan leaves, and says what it would remove") {
  const test::Darkroom darkroom;
  const fs::path store = darkroom.store();
  REQUIRE(run_program(store, {"store", "rm", "ball", "--yes"}).status == 0);
  const auto look = run_program(store, {"store", "gc", "--older-than", "0", "--dry-run", "--json"}).json();
  CHECK(look["removed"] == false);
  CHECK(look["objects"].get<int>() > 0);
  CHECK(run_program(store, {"store", "gc", "--json"}).json()["kept_young"] == look["objects"]);
  CHECK(run_program(store, {"store", "gc", "--older-than", "0", "--json"}).json()["objects"] == look["objects"]);
  CHECK(run_program(store, {"store", "gc", "--older-than", "0", "--json"}).json()["objects"] == 0);
}

TEST_CASE("verification of named scans does not resume") {
  const test::Darkroom darkroom;
  CHECK(run_program(darkroom.store(), {"store", "verify", "ball", "--resume"}).status == 2);
  CHECK(run_program(darkroom.store(), {"store", "verify", "nobody"}).status == 2);
}
