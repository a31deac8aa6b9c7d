// Scores of methods as JSON, as rows of a table, and in words.
#pragma once

#include <nlohmann/json.hpp>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "model/evaluation.h"

namespace lightstage::cli {

inline constexpr double kMebibyte = 1 << 20;

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

// {"rmse": "blend", ...}: the best method by each measure; empty for fewer than two methods.
nlohmann::ordered_json best_methods(std::span<const model::MethodScore> scores, const std::string& own_metric);

// The same in words: "lowest RMSE, H1: blend; lowest GMSD: rbf; highest MS-SSIM: blend".
std::string best_in_words(const nlohmann::ordered_json& best, const std::string& own_metric);

}  // namespace lightstage::cli
