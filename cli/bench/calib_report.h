// What `bench calib` measured as tables, as JSON and as a plot.
#pragma once

#include <string>
#include <vector>

#include <nlohmann/json.hpp>

#include "cli/bench/board_bench.h"
#include "cli/bench/calib_bench.h"
#include "cli/bench/exposure_bench.h"

namespace lightstage::cli {

// Rows of one kind: a table for people (empty where there are no rows) and an array for programs.
struct RowsReport {
  std::string text;
  nlohmann::ordered_json json = nlohmann::ordered_json::array();
};
RowsReport report(const std::vector<CalibRow>& rows);
RowsReport report(const std::vector<PhotographRow>& rows);
RowsReport report(const std::vector<BracketRow>& rows);
RowsReport report(const std::vector<BoardBenchRow>& rows);

// Time against error for every knob, as an SVG file.
std::string frontier_plot(const std::vector<CalibRow>& lights, const std::vector<BracketRow>& brackets,
                          const std::vector<BoardBenchRow>& boards);

}  // namespace lightstage::cli
