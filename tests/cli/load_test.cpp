// The store under load, and several programs on it at once.
#include <atomic>
#include <catch2/catch.hpp>
#include <thread>

#include "cli/program.h"
#include "db/store.h"
#include "support/support.h"

using namespace lightstage;
using test::Outcome;
using test::run_program;
namespace fs = std::filesystem;

TEST_CASE("bench store: small frames, 20,000 of them, through real passes: none lost, none wrong, memory flat") {
  const test::TemporaryFolder folder;
  const Outcome outcome =
      run_program(folder / "unused", {"bench", "store", "--folder", folder.path().string(), "--frames", "20000",
                                      "--rows", "4000", "--width", "16", "--height", "128", "--cameras", "12",
                                      "--lights", "128", "--fps", "1000", "--json"});
  INFO(outcome.err);
  REQUIRE(outcome.status == 0);
  const nlohmann::json bench = outcome.json();
  for (const char* key :
       {"ingest_bytes_per_s", "plain_write_bytes_per_s", "ratio", "verify_bytes_per_s", "plain_read_bytes_per_s",
        "list_ms_at_1m_rows", "start_ms_at_1m_rows", "verify_one_scan_ms_at_1m_rows", "peak_rss_bytes"}) {
    INFO(key);
    CHECK(bench[key].get<double>() > 0);
  }
  CHECK(bench["frames"].get<int>() >= 20'000);
  CHECK(bench["dropped"] == 0);
  CHECK(bench["wrong"] == 0);
  CHECK(bench["looked_at"].get<int>() > 100);
  CHECK(bench["rows"] == 4000);
  // Kept pictures would be 150 MB.
  CHECK(bench["late_rss_bytes"].get<double>() - bench["early_rss_bytes"].get<double>() < 40e6);
  CHECK(fs::is_empty(folder.path()));
}

TEST_CASE("bench store says so before it writes where the disk has no room for a round") {
  const test::TemporaryFolder folder;
  const Outcome outcome =
      run_program(folder / "unused", {"bench", "store", "--folder", folder.path().string(), "--width", "16384",
                                      "--height", "16384", "--lights", "10000", "--cameras", "12"});
  CHECK(outcome.status == 5);
  CHECK_THAT(outcome.err, Catch::Contains("MiB are free; free some, or take another --folder or fewer --lights"));
  CHECK(fs::is_empty(folder.path()));
}

TEST_CASE("programs work on one store at once: none of them finds it locked, and it is sound afterwards") {
  const test::TemporaryFolder folder;
  const fs::path store = folder / "store";
  const std::string stage = (folder / "stage.toml").string(), lit = (folder / "lit.exr").string(),
                    backup = (folder / "backup").string();
  const auto capture = [&](const std::string& name) {
    return run_program(store, {"capture", "--sim", "--procedural", "3", "--stage", stage, "--size", "48", "--name",
                               name, "--no-light-check"});
  };
  REQUIRE(run_program(store, {"stage", "--lights", "24", "--out", stage}).status == 0);
  REQUIRE(run_program(store, {"init"}).status == 0);
  const Outcome first = capture("head");
  INFO(first.err);
  REQUIRE(first.status == 0);

  // One after the other in each thread; the threads at once.
  std::atomic<bool> captured = false;
  std::vector<Outcome> outcomes[4];
  std::vector<std::thread> threads;
  threads.emplace_back([&] {
    for (const char* name : {"one", "two"}) outcomes[0].push_back(capture(name));
    captured = true;
  });
  const std::vector<std::vector<std::vector<std::string>>> others{
      {{"align", "head", "--flow", "dis-fast"}, {"relight", "head", "--light", "0.3,0.2,0.9", "--out", lit}},
      {{"store", "ls"}, {"store", "show", "head"}, {"store", "backup", backup}},
      {{"store", "verify", "head"}, {"store", "gc"}, {"store", "gc", "--older-than", "3600"}}};
  for (std::size_t t = 0; t < others.size(); ++t) {
    threads.emplace_back([&, t] {
      do {
        for (const std::vector<std::string>& arguments : others[t])
          outcomes[t + 1].push_back(run_program(store, arguments));
      } while (!captured);
    });
  }
  for (std::thread& thread : threads) thread.join();
  for (const std::vector<Outcome>& some : outcomes) {
    CHECK(some.size() >= 2);
    for (const Outcome& outcome : some) {
      INFO(outcome.out << outcome.err);
      CHECK(outcome.status == 0);
      CHECK(outcome.err.find("locked") == std::string::npos);
    }
  }
  CHECK(run_program(store, {"store", "verify"}).status == 0);
  // What the last backup holds is a store as sound.
  REQUIRE(run_program(store, {"store", "backup", backup}).status == 0);
  CHECK(run_program(backup, {"store", "verify"}).status == 0);
  const db::Store opened = db::Store::open(store);
  for (const char* name : {"head", "one", "two"}) {
    const db::Scan scan = opened.scan(name);
    CHECK(opened.frames(scan.id).size() == scan.steps.size());
  }
  std::error_code gone;
  const std::uintmax_t log = fs::file_size(store / "store.sqlite-wal", gone);
  CHECK((gone || log < (std::uintmax_t(17) << 20)));
}
