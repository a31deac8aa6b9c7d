// An evaluation as a folder of files: tables, plots, and a page with the crops in which methods differ most.
#pragma once

#include <filesystem>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "cli/evaluate/protocol.h"

namespace lightstage::cli {

// Scores on a stage of so many lights.
struct JudgedStage {
  std::size_t lights = 0;
  Protocol protocol;
  std::vector<MethodChoice> choices;
  std::vector<model::MethodScore> scores;  // of the choices, in their order
};

struct Report {
  std::string scan;
  std::string protocol;  // "subsample" where there are several stages
  bool linear_values = false;
  std::string own_metric;  // its file's stem, where there is one
  std::vector<JudgedStage> stages;
  nlohmann::ordered_json json;  // what the command prints
};

// A value as CSV holds it: in quotes where it must be.
std::string csv_field(const std::string& text);

// Table for people; a stage's lights come first where there are several stages.
std::vector<std::vector<std::string>> report_rows(const Report& report);

// Writes report.json, report.csv, by_angle.csv, report.md, error_by_angle.svg, error_by_time.svg (of several stages error_by_lights.svg), crops_N.png and
// index.html into the folder, which must exist.
void write_report(const std::filesystem::path& folder, const Report& report);

}  // namespace lightstage::cli
