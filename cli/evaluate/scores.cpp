#include "cli/evaluate/scores.h"

#include <algorithm>

#include "cli/format.h"
#include "cli/options.h"
#include "core/text.h"

namespace lightstage::cli {

namespace {

using model::MethodScore;
using nlohmann::ordered_json;

std::vector<Measure> all_measures(const std::string& own_metric) {
  using Value = std::optional<double>;
  return {
      {"rmse", "RMSE", false, [](const MethodScore& s) { return Value(s.rmse); }},
      {"h1", "H1", false, [](const MethodScore& s) { return Value(s.h1); }},
      {"dssim", "DSSIM", false, [](const MethodScore& s) { return Value(s.dssim); }},
      {"msssim", "MS-SSIM", true, [](const MethodScore& s) { return Value(s.msssim); }},
      {"gmsd", "GMSD", false, [](const MethodScore& s) { return Value(s.gmsd); }},
      {"flip", "FLIP", false, [](const MethodScore& s) { return Value(s.flip); }},
      {"hdr_flip", "HDR-FLIP", false, [](const MethodScore& s) { return s.hdr_flip; }},
      {"metric_model", own_metric, false, [](const MethodScore& s) { return s.own_error; }},
  };
}

const MethodScore& best(std::span<const MethodScore> scores, const Measure& measure) {
  return *std::min_element(scores.begin(), scores.end(), [&](const MethodScore& a, const MethodScore& b) {
    const double first = measure.of(a).value(), second = measure.of(b).value();
    return measure.more_is_better ? first > second : first < second;
  });
}

}  // namespace

std::vector<Measure> measures(std::span<const MethodScore> scores, const std::string& own_metric) {
  std::vector<Measure> all = all_measures(own_metric);
  std::erase_if(all, [&](const Measure& measure) {
    return std::any_of(scores.begin(), scores.end(), [&](const MethodScore& s) { return !measure.of(s); });
  });
  return all;
}

ordered_json scores_json(std::span<const MethodScore> scores, const std::string& own_metric) {
  ordered_json array = ordered_json::array();
  for (const MethodScore& score : scores) {
    ordered_json object{{"name", score.name}, {"images", score.images}};
    for (const Measure& measure : measures(scores, own_metric)) {
      if (measure.key == "metric_model") {
        object[measure.key] = {{own_metric, *measure.of(score)}};
      } else {
        object[measure.key] = *measure.of(score);
      }
    }
    object["seconds_per_image"] = score.seconds_per_image;
    object["peak_rss_bytes"] = or_null(score.peak_rss_bytes);
    object["by_angle"] = ordered_json::array();
    for (const model::AngleBin& bin : score.by_angle) {
      object["by_angle"].push_back({{"from_deg", bin.from_deg},
                                    {"to_deg", bin.to_deg},
                                    {"images", bin.images},
                                    {"rmse", or_null(bin.rmse)},
                                    {"dssim", or_null(bin.dssim)}});
    }
    array.push_back(std::move(object));
  }
  return array;
}

std::vector<std::vector<std::string>> score_rows(std::span<const MethodScore> scores, const std::string& own_metric) {
  const std::vector<Measure> shown = measures(scores, own_metric);
  std::vector<std::vector<std::string>> rows{{"method", "images"}};
  for (const Measure& measure : shown) rows[0].push_back(measure.title);
  rows[0].insert(rows[0].end(), {"s/image", "peak MiB"});
  for (const MethodScore& score : scores) {
    std::vector<std::string>& row = rows.emplace_back();
    row = {score.name, std::to_string(score.images)};
    for (const Measure& measure : shown) row.push_back(fixed(*measure.of(score), 4));
    row.push_back(fixed(score.seconds_per_image, 4));
    row.push_back(score.peak_rss_bytes ? fixed(double(*score.peak_rss_bytes) / kMebibyte, 0) : "-");
  }
  return rows;
}

ordered_json best_methods(std::span<const MethodScore> scores, const std::string& own_metric) {
  ordered_json object = ordered_json::object();
  if (scores.size() < 2) return object;
  for (const Measure& measure : measures(scores, own_metric)) object[measure.key] = best(scores, measure).name;
  return object;
}

std::string best_in_words(const ordered_json& best, const std::string& own_metric) {
  struct Win {
    std::string method;
    bool more_is_better;
    std::vector<std::string> titles;
  };
  std::vector<Win> wins;
  for (const Measure& measure : all_measures(own_metric)) {
    if (!best.contains(measure.key)) continue;
    const std::string winner = best[measure.key].get<std::string>();
    auto win = std::find_if(wins.begin(), wins.end(), [&](const Win& w) {
      return w.method == winner && w.more_is_better == measure.more_is_better;
    });
    if (win == wins.end()) win = wins.insert(wins.end(), {winner, measure.more_is_better, {}});
    win->titles.push_back(measure.title);
  }
  std::vector<std::string> phrases;
  for (const Win& win : wins) {
    phrases.push_back((win.more_is_better ? "highest " : "lowest ") + core::joined(win.titles, ", ") + ": " +
                      win.method);
  }
  return core::joined(phrases, "; ");
}

}  // namespace lightstage::cli
