// Capture in every timing mode, dry runs, and requests that contradict themselves, through the program.
#include <catch2/catch.hpp>

#include "cli/program.h"
#include "db/store.h"
#include "support/support.h"

using namespace lightstage;
using test::Outcome;
using test::run_program;

namespace {

struct Stage {
  Stage() {
    REQUIRE(run_program(store, {"init"}).status == 0);
    REQUIRE(run_program(store, {"stage", "--lights", "30", "--out", file}).status == 0);
  }
  Outcome capture(std::vector<std::string> arguments) const {
    arguments.insert(arguments.begin(), "capture");
    return run_program(store, arguments);
  }
  Outcome simulate(std::vector<std::string> more) const {
    std::vector<std::string> arguments{"--sim", "--grey-ball", "--stage", file, "--size", "24", "--no-noise"};
    arguments.insert(arguments.end(), more.begin(), more.end());
    return capture(arguments);
  }

  test::TemporaryFolder folder;
  std::filesystem::path store = folder / "store";
  std::string file = (folder / "stage.toml").string();
};

void check_refused(const Outcome& outcome, int status, const std::string& why) {
  INFO(outcome.err);
  CHECK(outcome.status == status);
  CHECK(outcome.err.find(why) != std::string::npos);
}

}  // namespace

TEST_CASE("every timing mode captures the same pictures") {
  const Stage stage;
  REQUIRE(stage.simulate({"--name", "lockstep"}).status == 0);
  for (const std::string timing : {"pipelined", "free_run"}) {
    CAPTURE(timing);
    const Outcome outcome = stage.simulate({"--timing", timing, "--name", timing, "--json"});
    INFO(outcome.err);
    REQUIRE(outcome.status == 0);
    CHECK(outcome.json()["timing"] == timing);
    CHECK(outcome.json()["retaken"] == 0);
    const db::Store store = db::Store::open(stage.store);
    const std::vector<db::Frame> expected = store.frames(store.scan("lockstep").id),
                                 frames = store.frames(store.scan(timing).id);
    REQUIRE(frames.size() == expected.size());
    for (std::size_t i = 0; i < frames.size(); ++i) {
      REQUIRE(frames[i].step_index == expected[i].step_index);
      const core::Image a = store.object(frames[i].object), b = store.object(expected[i].object);
      for (std::size_t p = 0; p < a.values().size(); ++p) {
        // LEDs are a little longer on before exposures that wait for the cameras.
        REQUIRE(a.values()[p] == Approx(b.values()[p]).margin(0.004));
      }
    }
  }
}

TEST_CASE("a dry run tells how fast each mode goes and stores nothing") {
  const Stage stage;
  const Outcome outcome = stage.simulate({"--dry-run", "--json"});
  INFO(outcome.err);
  REQUIRE(outcome.status == 0);
  const auto modes = outcome.json()["modes"];
  REQUIRE(modes.size() == 3);
  for (const auto& mode : modes) {
    CHECK(mode["steps_per_s"].get<double>() > 1);
    CHECK(mode["safe"] == true);
  }
  CHECK(db::Store::open(stage.store).scans().empty());
}

TEST_CASE("the light check names a dead light before anything is stored") {
  const test::TemporaryFolder folder;
  const std::string file = (folder / "stage.toml").string();
  REQUIRE(run_program(folder / "store", {"init"}).status == 0);
  REQUIRE(run_program(folder / "store", {"stage", "--lights", "60", "--dead", "7", "--out", file}).status == 0);
  const std::vector<std::string> command{"capture", "--sim", "--grey-ball", "--stage", file,
                                         "--size",  "48",    "--name",      "ball",    "--light-check"};
  const Outcome outcome = run_program(folder / "store", command);
  check_refused(outcome, 4, "light 7 is dead");
  CHECK(db::Store::open(folder / "store").scans().empty());
}

TEST_CASE("bench capture ranks the timing modes and finds no wrong frame") {
  const Stage stage;
  const Outcome outcome = run_program(stage.store, {"bench", "capture", "--lights", "30", "--loss", "3", "--json"});
  INFO(outcome.err);
  REQUIRE(outcome.status == 0);
  const auto modes = outcome.json()["modes"];
  REQUIRE(modes.size() == 3);
  for (const auto& mode : modes) {
    CHECK(mode["wrong"] == 0);
    CHECK(mode["lights_left_on"] == false);
  }
  CHECK(modes[0]["ratio_to_lockstep"] == 1.0);
}

TEST_CASE("captures that contradict themselves or their stage are refused, with nothing stored") {
  const Stage stage;
  check_refused(stage.capture({"--stage", stage.file, "--name", "x"}), 2, "names no LED controllers");
  check_refused(stage.capture({"--stage", stage.file, "--name", "x", "--procedural", "3"}), 2, "--sim");
  check_refused(stage.capture({"--resume", "--name", "x", "--stage", stage.file}), 2, "--resume");
  check_refused(stage.simulate({}), 2, "--name");
  check_refused(stage.simulate({"--name", "x", "--timing", "warp"}), 2, "warp");
  check_refused(stage.simulate({"--name", "x", "--preview", (stage.folder / "no" / "p.png").string()}), 3, "p.png");
  check_refused(run_program(stage.store, {"lights-off", "--stage", stage.file}), 2, "controller");
  CHECK(db::Store::open(stage.store).scans().empty());
}
