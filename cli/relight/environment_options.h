// How exactly environments are to be carried.
#pragma once

#include <optional>
#include <string>
#include <utility>

#include <nlohmann/json.hpp>

#include "relight/environment_relighter.h"

namespace CLI {
class App;
}

namespace lightstage::cli {

struct EnvironmentOptions {
  std::optional<double> error;
  relight::ErrorMeasure measure = relight::ErrorMeasure::kDssim;
  std::string budget;   // "20s", "2min", or seconds
  std::string quality;  // draft, good or exact
  bool exhaustive = false;
  std::string size;  // "256x128": of the map; empty, as it is

  // Whether any of it stands on the command line.
  bool given() const { return error || exhaustive || !budget.empty() || !quality.empty() || !size.empty(); }

  // Throws UsageError for values that are no numbers, and where more than one goal is given. Without one: good.
  relight::Goal goal() const;
  relight::Environment resized(relight::Environment environment) const;

  // What of it decides how a picture looks.
  nlohmann::ordered_json json() const;

 private:
  std::pair<int, int> map_size() const;
};

// Adds --error, --error-measure, --budget, --quality, --exhaustive and --size.
void add_environment_options(CLI::App& command, EnvironmentOptions& options);

// What was asked, what is expected to be kept, and where the time went.
nlohmann::ordered_json plan_json(const relight::Plan& plan);

}  // namespace lightstage::cli
