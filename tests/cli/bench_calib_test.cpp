#include <catch2/catch.hpp>
#include <fstream>

#include "cli/program.h"
#include "support/support.h"

using namespace lightstage;
using test::run_program;

TEST_CASE("bench calib says how good a calibration is, and writes what it prints") {
  const test::TemporaryFolder folder;
  const test::Outcome outcome =
      run_program(folder / "store", {"bench", "calib", "--lights", "24", "--stages", "1", "--ball-px", "64",
                                     "--no-frontier", "--out", folder / "out", "--json"});
  INFO(outcome.err);
  REQUIRE(outcome.status == 0);
  const nlohmann::json found = outcome.json();
  CHECK(found["lights"] == 24);
  CHECK(found["placed"] >= 22);
  CHECK(found["median_deg"] < 0.1);
  CHECK(found["median_position_mm"] < 20);
  CHECK(found["direction_error_over_sigma"] > 0.5);
  CHECK(found["direction_error_over_sigma"] < 2);
  CHECK(found["gains"]["measured"] >= 18);
  CHECK(found["gains"]["median_error"] < 0.01);
  CHECK(found["gains"]["error_over_sigma"] > 0.5);
  CHECK(found["gains"]["error_over_sigma"] < 2);
  CHECK(found["hdr_linearity_percent"] < 0.5);
  for (const char* rows : {"photographs", "frontier", "bracket_frontier", "board_frontier"}) {
    INFO(rows);
    CHECK(found[rows].empty());
  }
  std::ifstream file(folder / "out" / "calib.json");
  CHECK(nlohmann::json::parse(file) == found);
  CHECK(std::filesystem::exists(folder / "out" / "calib.txt"));
  CHECK_FALSE(std::filesystem::exists(folder / "out" / "calib.svg"));
  CHECK_FALSE(std::filesystem::exists(folder / "store"));
}
