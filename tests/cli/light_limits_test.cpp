// Sequences that would flash or heat too much, through the program; and the simulated controller, which keeps its limits.
#include <catch2/catch.hpp>

#include <SQLiteCpp/SQLiteCpp.h>

#include <fstream>

#include "cli/program.h"
#include "core/file.h"
#include "db/store.h"
#include "support/support.h"

using namespace lightstage;
using Catch::Matchers::Contains;
using test::Outcome;
using test::run_program;

namespace {

struct Stage {
  Stage() {
    REQUIRE(run_program(store, {"init"}).status == 0);
    REQUIRE(run_program(store, {"stage", "--lights", "40", "--out", file}).status == 0);
  }
  Outcome capture(std::vector<std::string> more) const {
    std::vector<std::string> arguments{"capture", "--sim",  "--procedural", "3",         "--stage",
                                       file,      "--size", "24",           "--no-noise"};
    arguments.insert(arguments.end(), more.begin(), more.end());
    return run_program(store, arguments);
  }
  // The stage file with a line of [limits] changed.
  void change(const std::string& from, const std::string& to) const {
    std::string text = core::read_text_file(file);
    REQUIRE(text.find(from) != std::string::npos);
    text.replace(text.find(from), from.size(), to);
    core::write_file_atomically(file, text);
  }
  std::string write(const std::string& sequence) const {
    core::write_file_atomically(folder / "sequence.toml", sequence);
    return (folder / "sequence.toml").string();
  }
  nlohmann::json provenance(const std::string& name) const {
    return nlohmann::json::parse(db::Store::open(store).scan(name).provenance);
  }

  test::TemporaryFolder folder;
  std::filesystem::path store = folder / "store";
  std::string file = (folder / "stage.toml").string();
};

// All lights, and a pause, over and over.
std::string strobe(int times, double pause_ms) {
  std::string text;
  for (int i = 0; i < times; ++i) {
    text += "[[step]]\nkind = \"full_on\"\nexposure_ms = 20.0\n[[step]]\nkind = \"dark\"\nexposure_ms = " +
            std::to_string(pause_ms) + "\n";
  }
  return text;
}

}  // namespace

TEST_CASE(
    "a pass that would strobe the stage is refused with nothing stored, and taken and recorded when somebody knows") {
  const Stage stage;
  const std::string sequence = stage.write(strobe(8, 50));
  const Outcome refused = stage.capture({"--name", "strobe", "--sequence", sequence});
  INFO(refused.err);
  CHECK(refused.status == 2);
  CHECK_THAT(refused.err,
             Contains("the stage would flash ") && Contains("which can set off seizures") && Contains("--i-know"));
  CHECK(db::Store::open(stage.store).scans().empty());
  CHECK(std::count(refused.err.begin(), refused.err.end(), '\n') == 1);

  const Outcome taken = stage.capture({"--name", "strobe", "--sequence", sequence, "--i-know"});
  INFO(taken.err);
  CHECK(taken.status == 0);
  CHECK_THAT(taken.err, Contains("taken all the same (--i-know)"));
  CHECK_THAT(stage.provenance("strobe")["i_know"].at(0).get<std::string>(), Contains("the stage would flash "));
  CHECK(run_program(stage.store, {"capture", "--resume", "--name", "strobe"}).status == 0);  // nothing is missing

  // With pauses it is harmless, and nothing is recorded.
  const Outcome slow = stage.capture({"--name", "slow", "--sequence", stage.write(strobe(8, 350))});
  INFO(slow.err);
  CHECK(slow.status == 0);
  CHECK_FALSE(stage.provenance("slow").contains("i_know"));
}

TEST_CASE("what a pass still lacks is held against the limits before it is lit, whoever knew when it was begun") {
  const Stage stage;
  REQUIRE(stage.capture({"--name", "strobe", "--sequence", stage.write(strobe(8, 50)), "--i-know"}).status == 0);
  const auto forget = [&](int steps) {
    SQLite::Database((stage.store / "store.sqlite").string(), SQLite::OPEN_READWRITE)
        .exec("DELETE FROM frames WHERE step_index >= " + std::to_string(16 - steps));
  };
  const auto frames = [&] {
    const db::Store store = db::Store::open(stage.store);
    return store.frames(store.scan("strobe").id).size();
  };
  forget(12);
  const Outcome refused = run_program(stage.store, {"capture", "--resume", "--name", "strobe"});
  INFO(refused.err);
  CHECK(refused.status == 2);
  CHECK_THAT(refused.err, Contains("the stage would flash ") && Contains("--i-know"));
  CHECK(frames() == 4);
  const Outcome taken = run_program(stage.store, {"capture", "--resume", "--name", "strobe", "--i-know"});
  INFO(taken.err);
  CHECK(taken.status == 0);
  CHECK(frames() == 16);
  CHECK(stage.provenance("strobe")["i_know"].size() >= 1);
  // The rest alone may well be harmless.
  forget(4);
  CHECK(run_program(stage.store, {"capture", "--resume", "--name", "strobe"}).status == 0);
  CHECK(frames() == 16);
}

TEST_CASE(
    "tracking frames that would flash too often are refused where they were asked for, and made fewer where not") {
  const Stage stage;
  // Short exposures: cameras are not ready sooner, so that tracking frames stay on.
  const Outcome refused = stage.capture({"--name", "head", "--exposure", "4", "--tracking-every", "3"});
  INFO(refused.err);
  CHECK(refused.status == 2);
  CHECK_THAT(refused.err, Contains("(tracking)") && Contains("--tracking-every"));
  const Outcome fewer = stage.capture({"--name", "head", "--exposure", "4", "--json"});
  INFO(fewer.err);
  CHECK(fewer.status == 0);
  CHECK_THAT(fewer.err, Contains("th light, not every 10th: these would flash too often"));
  for (const std::string timing : {"pipelined", "free_run"}) {
    const Outcome fast = stage.capture({"--name", timing, "--timing", timing, "--json"});
    INFO(fast.err);
    CHECK(fast.status == 0);
    CHECK(fast.json()["retaken"] == 0);
  }
}

TEST_CASE("a light that would be on for too long is refused; the controller keeps that limit against those who know") {
  const Stage stage;
  stage.change("on_time_s = 0.0", "on_time_s = 1.0");
  const std::string sequence = stage.write("[[step]]\nkind = \"full_on\"\nexposure_ms = 1500.0\n");
  const Outcome refused = stage.capture({"--name", "hot", "--sequence", sequence});
  INFO(refused.err);
  CHECK(refused.status == 2);
  CHECK_THAT(refused.err, Contains("light 0 would be on for longer than 1 s without a break"));
  const Outcome broken_off = stage.capture({"--name", "hot", "--sequence", sequence, "--i-know"});
  INFO(broken_off.err);
  CHECK(broken_off.status == 4);
  CHECK_THAT(broken_off.err, Contains("an output was on for longer than its limit"));
  CHECK(db::Store::open(stage.store).frames(db::Store::open(stage.store).scan("hot").id).empty());
}

TEST_CASE("a dry run leaves out what must not be tried") {
  const Stage stage;
  const Outcome outcome = stage.capture({"--dry-run", "--json"});
  INFO(outcome.err);
  REQUIRE(outcome.status == 0);
  const nlohmann::json modes = outcome.json()["modes"];
  INFO(modes.dump());
  REQUIRE(modes.size() == 3);
  CHECK(modes[0]["safe"] == true);
  // As fast as that its tracking frames would flash; the sequence is not tried in it.
  CHECK(modes[1]["timing"] == "pipelined");
  CHECK_THAT(modes[1]["problem"].get<std::string>(), Contains("would flash 4 times within a second"));
  CHECK_FALSE(modes[1].contains("frames"));
  CHECK(modes[2]["safe"] == true);
  CHECK(stage.capture({"--dry-run", "--sequence", stage.write(strobe(8, 50))}).status == 2);
}
