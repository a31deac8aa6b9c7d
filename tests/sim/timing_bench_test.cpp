#include "sim/timing_bench.h"

#include <catch2/catch.hpp>

#include "core/progress.h"

using namespace lightstage;

TEST_CASE("on the simulated stage every mode keeps right frames only, with and without losses") {
  core::set_quiet(true);
  const double drop_probability = GENERATE(0.0, 0.05);
  CAPTURE(drop_probability);
  sim::TimingBenchOptions options;
  options.lights = 40;
  options.drop_probability = drop_probability;
  const std::vector<sim::TimingRow> rows = sim::bench_timing(options);
  REQUIRE(rows.size() == 3);
  for (const sim::TimingRow& row : rows) {
    CAPTURE(capture::to_string(row.timing));
    CHECK(row.wrong == 0);
    CHECK_FALSE(row.lights_left);
    CHECK(row.report.stored == row.report.steps * 2);
    if (drop_probability > 0) CHECK(row.report.retaken > 0);
  }
  CHECK(rows[1].steps_per_s > rows[0].steps_per_s);
}

TEST_CASE("cameras without a trigger input are captured in lockstep and, faster, in free run") {
  core::set_quiet(true);
  // At 200 pictures a second several more exposures are under way when a frame comes.
  const int fps = GENERATE(60, 200);
  CAPTURE(fps);
  sim::TimingBenchOptions options;
  options.lights = 40;
  options.exposure = 2 * core::kMillisecond;
  options.times.shortest_period = core::kSecond / fps;
  options.times.triggered = options.times.stamped_on_arrival = false;
  const std::vector<sim::TimingRow> rows = sim::bench_timing(options);
  REQUIRE(rows.size() == 2);
  for (const sim::TimingRow& row : rows) {
    CAPTURE(capture::to_string(row.timing), row.problem);
    CHECK(row.wrong == 0);
    CHECK_FALSE(row.lights_left);
    CHECK(row.report.stored == row.report.steps * 2);
  }
  CHECK(rows[1].timing == capture::Timing::kFreeRun);
  CHECK(rows[1].steps_per_s > rows[0].steps_per_s);
}
