#include <catch2/catch.hpp>
#include <fstream>

#include "cli/program.h"
#include "support/support.h"

using namespace lightstage;
using test::run_program;

TEST_CASE("every command has help with an example, on stdout, and succeeds") {
  const test::TemporaryFolder folder;
  for (const std::string command :
       {"init",     "stage",   "capture",    "calibrate", "align",       "import",   "export", "train",
        "superres", "relight", "normals",    "sky",       "methods",     "evaluate", "store",  "model",
        "bench",    "doctor",  "lights-off", "demo",      "analyze-env", "merge"}) {
    INFO(command);
    const test::Outcome help = run_program(folder / "store", {command, "--help"});
    CHECK(help.status == 0);
    CHECK(help.err.empty());
    CHECK(help.out.find("Example") != std::string::npos);
    CHECK(help.out.find("lightstage " + command) != std::string::npos);
  }
  CHECK(run_program(folder / "store", {"--help"}).out.find("relight") != std::string::npos);
  // Without what CLI11 would put behind flags: {false}.
  CHECK(run_program(folder / "store", {"capture", "--help"}).out.find(",--no-light-check\n") != std::string::npos);
  CHECK_FALSE(std::filesystem::exists(folder / "store"));
}

TEST_CASE("what is misspelt is answered with the nearest name and exit status 2") {
  const test::TemporaryFolder folder;
  const auto fails_with = [&](std::vector<std::string> arguments, const std::string& hint) {
    const test::Outcome outcome = run_program(folder / "store", std::move(arguments));
    INFO(outcome.err);
    CHECK(outcome.status == 2);
    CHECK(outcome.out.empty());
    CHECK(std::count(outcome.err.begin(), outcome.err.end(), '\n') == 1);
    CHECK(outcome.err.find(hint) != std::string::npos);
  };
  fails_with({"captrue"}, "no command 'captrue' (did you mean 'capture'?)");
  fails_with({"store", "verifi"}, "no command 'verifi' (did you mean 'verify'?)");
  fails_with({"relight", "head", "--lihgt", "0,0,1", "--out", "a.exr"},
             "no option '--lihgt' (did you mean '--light'?)");
  fails_with({"init", "--jsn"}, "(did you mean '--json'?)");
  fails_with({"superres", "head"}, "--out");
  fails_with({"capture", "--stage", "x.toml", "--sim", "--procedural", "1", "--views", "3", "--name", "x"}, "--views");
  fails_with({"align", "head", "--flow", "fien"}, "--flow: 'fien' is none of");
  fails_with({"align", "head", "--flow", "fien"}, "(did you mean 'fine'?)");
  fails_with({"align", "head", "--flow", "3"}, "--flow: '3' is none of");
  fails_with({}, "lightstage --help");
  fails_with({"stage", "--lights", "-4", "--out", "x.toml"}, "--lights");
  fails_with({"stage", "--lights", "many", "--out", "x.toml"}, "--lights");
}

TEST_CASE("the commands that stand on a missing store say how to make one") {
  const test::TemporaryFolder folder;
  const test::Outcome outcome = run_program(folder / "nowhere", {"store", "ls"});
  CHECK(outcome.status == 5);
  CHECK(outcome.err.find("nowhere") != std::string::npos);
  CHECK(outcome.err.find("lightstage init") != std::string::npos);
}

TEST_CASE("doctor reports what the machine offers") {
  const test::TemporaryFolder folder;
  const test::Outcome outcome = run_program(folder / "store", {"doctor", "--json", "--threads", "1"});
  CHECK(outcome.status == 0);
  const auto report = outcome.json();
  CHECK(report["threads"] == 1);
  CHECK(report["torch"].get<std::string>().starts_with("1."));
  CHECK(report["fast_blas"].is_boolean());
  for (const char* list : {"controllers", "cameras", "gpio_chips", "problems"}) CHECK(report[list].is_array());
}

TEST_CASE("doctor says what keeps a stage from being captured with") {
  const test::TemporaryFolder folder;
  const std::string file = (folder / "stage.toml").string();
  REQUIRE(run_program(folder / "store", {"stage", "--lights", "3", "--out", file}).status == 0);
  const test::Outcome drawn = run_program(folder / "store", {"doctor", "--json", "--stage", file});
  CHECK(drawn.status == 4);
  CHECK(drawn.json()["ok"] == false);
  CHECK(drawn.json()["stage_problems"][0] == "stage stage: the file has no [[controller]]: see docs/hardware.md");

  std::ofstream(file, std::ios::app)
      << "[[controller]]\nname = \"dome\"\nkind = \"lightstage\"\nserial = \"no such\"\n";
  const test::Outcome missing = run_program(folder / "store", {"doctor", "--stage", file});
  CHECK(missing.status == 4);
  CHECK(missing.out.find("controller dome: no lightstage controller with the serial number 'no such'") !=
        std::string::npos);
}

TEST_CASE("lights-off names the controllers that may still be lit") {
  const test::TemporaryFolder folder;
  const std::string file = (folder / "stage.toml").string();
  REQUIRE(run_program(folder / "store", {"stage", "--lights", "3", "--out", file}).status == 0);
  const test::Outcome drawn = run_program(folder / "store", {"lights-off", "--stage", file});
  CHECK(drawn.status == 2);
  CHECK(drawn.err.find("docs/hardware.md") != std::string::npos);

  std::ofstream(file, std::ios::app)
      << "[[controller]]\nname = \"dome\"\nkind = \"lightstage\"\nserial = \"no such\"\n";
  const test::Outcome missing = run_program(folder / "store", {"lights-off", "--json", "--stage", file});
  CHECK(missing.status == 4);
  CHECK(missing.json()["failed"].size() == 1);
  CHECK(missing.err.find("controller dome") != std::string::npos);
  CHECK(run_program(folder / "store", {"lights-off"}).status == 2);
}

TEST_CASE("seeds that do not fit are refused and not taken for others") {
  const test::TemporaryFolder folder;
  for (const char* seed : {"99999999999999999999", "18446744073709551616", "-1", "1.5", "seven", ""}) {
    CAPTURE(seed);
    for (const char* option : {"--procedural", "--seed"}) {
      const test::Outcome refused =
          test::run_program(folder / "store", {"capture", "--sim", option, seed, "--name", "head"});
      CHECK(refused.status == 2);
      CHECK_THAT(refused.err, Catch::Contains(option));
    }
  }
  // The largest one that there is gets further.
  CHECK(test::run_program(folder / "store", {"capture", "--sim", "--procedural", "18446744073709551615", "--stage",
                                             (folder / "none.toml").string(), "--name", "head"})
            .status != 2);
}
