// Several processes on one store.
#include <catch2/catch.hpp>

#include <chrono>
#include <csignal>
#include <fstream>
#include <thread>

#include <unistd.h>

#include "cli/program.h"
#include "db/scan_lock.h"
#include "db/store.h"
#include "support/support.h"

using namespace lightstage;
using Catch::Matchers::Contains;
using test::Outcome;
using test::run_program;
namespace fs = std::filesystem;

namespace {

struct Stage {
  Stage() {
    REQUIRE(run_program(store, {"init"}).status == 0);
    REQUIRE(run_program(store, {"stage", "--lights", "60", "--out", file}).status == 0);
  }
  std::vector<std::string> capture(const std::string& name, int size) const {
    return {"capture", "--sim", "--procedural", "3", "--stage", file, "--size", std::to_string(size), "--name", name};
  }
  std::size_t frames(const std::string& name) const {
    const db::Store reader = db::Store::open(store);
    const auto scan = reader.find_scan(name);
    return scan ? reader.frames(scan->id).size() : 0;
  }
  void wait_for_frames(const std::string& name, std::size_t wanted) const {
    const auto deadline = std::chrono::steady_clock::now() + std::chrono::seconds(60);
    while (frames(name) < wanted) {
      REQUIRE(std::chrono::steady_clock::now() < deadline);
      std::this_thread::sleep_for(std::chrono::milliseconds(2));
    }
  }

  test::TemporaryFolder folder;
  fs::path store = folder / "store";
  std::string file = (folder / "stage.toml").string();
};

}  // namespace

TEST_CASE(
    "while a scan is being captured nobody else takes its frames or removes it, until the process ends, however it "
    "does") {
  const Stage stage;
  test::BackgroundRun first(stage.store, stage.capture("head", 256));
  stage.wait_for_frames("head", 3);
  const std::string who = "scan 'head' is being captured by process " + std::to_string(first.pid());
  const std::vector<std::vector<std::string>> others{stage.capture("head", 32),
                                                     {"capture", "--resume", "--name", "head"},
                                                     {"capture", "--retake", "--name", "head"},
                                                     {"store", "rm", "head", "--yes"}};
  for (const std::vector<std::string>& other : others) {
    const Outcome refused = run_program(stage.store, other);
    INFO(refused.err);
    CHECK(refused.status == 5);
    CHECK_THAT(refused.err, Contains(who) && Contains("wait until that ends, or end it"));
  }
  first.signal(SIGKILL);
  REQUIRE(first.wait() == 128 + SIGKILL);
  const std::size_t kept = stage.frames("head");
  const Outcome resumed = run_program(stage.store, {"capture", "--resume", "--name", "head", "--json"});
  INFO(resumed.err);
  REQUIRE(resumed.status == 0);
  CHECK(resumed.json()["already_stored"] == kept);
  CHECK(fs::is_empty(stage.store / "locks"));
  CHECK(run_program(stage.store, {"store", "verify", "--json"}).json()["ok"] == true);
  CHECK(run_program(stage.store, {"store", "rm", "head", "--yes"}).status == 0);
}

TEST_CASE("scans are aligned, relit, super-resolved and removed while others are captured") {
  const Stage stage;
  REQUIRE(run_program(stage.store, stage.capture("done", 48)).status == 0);
  REQUIRE(run_program(stage.store, stage.capture("old", 24)).status == 0);
  test::BackgroundRun one(stage.store, stage.capture("one", 320)), two(stage.store, stage.capture("two", 320));
  stage.wait_for_frames("one", 2);
  stage.wait_for_frames("two", 2);
  const std::string lit = (stage.folder / "lit.exr").string();
  const std::vector<std::vector<std::string>> readers{
      {"align", "done", "--flow", "dis-fast"},
      {"relight", "done", "--light", "0.2,0.3,0.9", "--method", "linear", "--out", lit},
      {"superres", "done", "--lights", "70", "--method", "linear", "--out", "dense"},
      {"store", "rm", "old", "--yes"},
      {"store", "show", "one"},
      {"store", "backup", (stage.folder / "backup").string()}};
  for (const std::vector<std::string>& command : readers) {
    const Outcome outcome = run_program(stage.store, command);
    CAPTURE(command.front(), outcome.err);
    CHECK(outcome.status == 0);
  }
  CHECK(one.wait() == 0);
  CHECK(two.wait() == 0);
  CHECK(stage.frames("one") == stage.frames("two"));
  CHECK(run_program(stage.store, {"store", "verify", "--json"}).json()["ok"] == true);
}

TEST_CASE("a lock that its holder left behind does not hold, and names that point elsewhere stay in the store") {
  const test::TemporaryFolder folder;
  fs::create_directories(folder / "store/locks");
  std::ofstream(folder / "store/locks/head") << "1 is being captured";
  {
    const db::ScanLock lock(folder / "store", "head", "is being captured");
    CHECK_THROWS_WITH(db::ScanLock(folder / "store", "head", "is being removed"),
                      Contains("scan 'head' is being captured by process " + std::to_string(getpid())));
    const db::ScanLock other(folder / "store", "head2", "is being captured");
    const db::ScanLock outside(folder / "store", "../../out", "is being captured");
    const db::ScanLock long_name(folder / "store", std::string(5000, 'x'), "is being captured");
  }
  CHECK(fs::is_empty(folder / "store/locks"));
  CHECK_FALSE(fs::exists(folder.path().parent_path() / "out"));
  const db::ScanLock again(folder / "store", "head", "is being captured");
}
