#include <catch2/catch.hpp>
#include <chrono>
#include <csignal>
#include <set>
#include <thread>

#include "cli/darkroom.h"
#include "cli/program.h"
#include "db/store.h"
#include "support/support.h"

using namespace lightstage;
using test::run_program;

namespace {

struct Capture {
  explicit Capture(const test::TemporaryFolder& folder)
      : store(folder / "store"), arguments{"capture", "--sim",   "--procedural",
                                           "3",       "--stage", (folder / "stage.toml").string(),
                                           "--size",  "64",      "--name",
                                           "head"} {
    REQUIRE(run_program(store, {"init"}).status == 0);
    REQUIRE(run_program(store, {"stage", "--lights", "60", "--out", (folder / "stage.toml").string()}).status == 0);
  }

  // Returns once so many frames are in the store.
  void wait_for_frames(std::size_t wanted) const {
    const auto deadline = std::chrono::steady_clock::now() + std::chrono::seconds(60);
    while (std::chrono::steady_clock::now() < deadline) {
      const db::Store reader = db::Store::open(store);
      if (const auto scan = reader.find_scan("head")) {
        if (reader.frames(scan->id).size() >= wanted) return;
      }
      std::this_thread::sleep_for(std::chrono::milliseconds(5));
    }
    FAIL("no frames within a minute");
  }

  void check_resumed() const {
    const test::Outcome resumed = run_program(store, {"capture", "--resume", "--name", "head", "--json"});
    INFO(resumed.err);
    REQUIRE(resumed.status == 0);
    CHECK(resumed.json()["already_stored"].get<int>() > 0);
    const db::Store reader = db::Store::open(store);
    const db::Scan scan = reader.scan("head");
    std::multiset<int> steps;
    for (const db::Frame& frame : reader.frames(scan.id)) steps.insert(frame.step_index);
    CHECK(steps.size() == scan.steps.size());
    for (const db::Step& step : scan.steps) CHECK(steps.count(step.step_index) == 1);
    const test::Outcome verified = run_program(store, {"store", "verify", "--json"});
    INFO(verified.out);
    CHECK(verified.json()["ok"] == true);
  }

  std::filesystem::path store;
  std::vector<std::string> arguments;
};

}  // namespace

TEST_CASE("a capture killed in mid pass goes on where it was, and every step is there once") {
  const test::TemporaryFolder folder;
  const Capture capture(folder);
  test::BackgroundRun run(capture.store, capture.arguments);
  capture.wait_for_frames(20);
  run.signal(SIGKILL);
  REQUIRE(run.wait() == 128 + SIGKILL);
  capture.check_resumed();
}

TEST_CASE("Ctrl-C ends a capture between frames with status 130, and it can go on") {
  const test::TemporaryFolder folder;
  const Capture capture(folder);
  test::BackgroundRun run(capture.store, capture.arguments);
  capture.wait_for_frames(10);
  run.signal(SIGINT);
  REQUIRE(run.wait() == 130);
  capture.check_resumed();
}

TEST_CASE("Ctrl-C ends a report while its crops are rendered, with status 130 and without a page") {
  const test::Darkroom darkroom;
  const std::filesystem::path report = darkroom / "report";
  test::BackgroundRun run(darkroom.store(), {"evaluate", "ball", "--held-out", "--every", "12", "--method",
                                             "blend,rbf,linear", "--report", report.string(), "--quiet"});
  const auto deadline = std::chrono::steady_clock::now() + std::chrono::seconds(60);
  // The last file before the crops.
  while (!std::filesystem::exists(report / "error_by_time.svg") && std::chrono::steady_clock::now() < deadline)
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  run.signal(SIGINT);
  CHECK(run.wait() == 130);
  CHECK(std::filesystem::exists(report / "report.json"));
  CHECK_FALSE(std::filesystem::exists(report / "index.html"));
}
