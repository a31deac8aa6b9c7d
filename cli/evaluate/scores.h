// Scores of methods as JSON, as rows of a table, and in words.
#pragma once

#include <nlohmann/json.hpp>
#include <span>
#include <string>
#include <vector>

#include "model/evaluation.h"

namespace lightstage::cli {

// An error measure that reports show.
struct Measure {
  std::string key;    // in JSON and CSV: "rmse"
  std::string title;  // for people: "RMSE"
  bool more_is_better = false;
  std::optional<double> (*of)(const model::MethodScore&);
};

// All of them, those that were not taken left out; the user's own is titled `own_metric`, its file's stem.
std::vector<Measure> measures(std::span<const model::MethodScore> scores, const std::string& own_metric);

// The array `methods` of evaluate's JSON (docs/cli.md).
nlohmann::ordered_json scores_json(std::span<const model::MethodScore> scores, const std::string& own_metric);

// A head and a row a method: name, images, measures, seconds an image, peak of memory in MiB.
std::vector<std::vector<std::string>> score_rows(std::span<const model::MethodScore> scores,
                                                 const std::string& own_metric);

// "lowest RMSE, H1 and DSSIM: blend; lowest GMSD: rbf; highest MS-SSIM: blend": the best method by each measure. Empty for fewer than two methods.
std::string best_by_each(std::span<const model::MethodScore> scores, const std::string& own_metric);

}  // namespace lightstage::cli
