#include "cli/evaluate/frontier.h"

#include <algorithm>
#include <cmath>
#include <functional>

#include "cli/evaluate/report.h"
#include "cli/evaluate/scores.h"
#include "cli/format.h"
#include "cli/options.h"
#include "cli/report/plot.h"
#include "core/error.h"
#include "core/file.h"
#include "core/progress.h"
#include "core/sphere.h"
#include "core/text.h"
#include "model/alias_free_weights.h"
#include "model/pareto_front.h"

namespace lightstage::cli {

namespace {

using nlohmann::ordered_json;

// What to change of a method's options to trade quality for time or memory.
struct QualitySetting {
  std::string label;
  std::function<void(model::MethodOptions&)> apply;
};

// What of a knob trades quality for time or memory, besides its default; `sharpness` is linear's own choice for the scan.
std::vector<std::string> values_to_try(const std::string& option, double sharpness) {
  if (option == "--neighbours") return {"3", "4", "6", "12", "16"};
  if (option == "--sharpness") return {core::number_text(sharpness / 4, 3), core::number_text(4 * sharpness, 3)};
  if (option == "--domain" || option == "--kernel") return {"linear"};
  if (option == "--smoothing") return {"1e-4", "1e-3"};
  if (option == "--bf16" || option == "--half-cache") return {"on"};
  return {};
}

std::vector<QualitySetting> quality_settings(const std::string& method, double sharpness) {
  std::vector<QualitySetting> settings;
  for (const model::Knob& knob : model::method_info(method).knobs) {
    if (!knob.set) continue;
    for (const std::string& value : values_to_try(knob.option, sharpness)) {
      settings.push_back({knob.flag ? knob.option : knob.option + " " + value,
                          [&knob, value](model::MethodOptions& options) { knob.set(options, value); }});
    }
  }
  if (method == "blend" || method == "superres" || method == "xu_adaptive") {
    for (const int k : {4, 6, 12}) {
      settings.push_back(
          {std::to_string(k) + " neighbours", [k](model::MethodOptions& o) { o.network.neighbours = k; }});
    }
  }
  return settings;
}

double cost_of(const model::MethodScore& score, bool memory) {
  if (!memory) return score.seconds_per_image;
  return score.peak_rss_bytes ? double(*score.peak_rss_bytes) : NAN;
}

std::vector<model::MethodScore> scores_of(const std::vector<FrontierPoint>& points) {
  std::vector<model::MethodScore> scores;
  for (const FrontierPoint& point : points) scores.push_back(point.score);
  return scores;
}

void mark_fronts(std::vector<FrontierPoint>& points, const std::string& own_metric) {
  for (const Measure& measure : measures(scores_of(points), own_metric)) {
    for (const bool memory : {false, true}) {
      std::vector<model::CostAndError> trades;
      for (const FrontierPoint& point : points) {
        const double value = *measure.of(point.score);
        trades.push_back({cost_of(point.score, memory), measure.more_is_better ? -value : value});
      }
      const std::vector<bool> on_front = model::pareto_front(trades);
      for (std::size_t i = 0; i < points.size(); ++i) {
        if (on_front[i]) (memory ? points[i].memory_fronts : points[i].time_fronts).push_back(measure.key);
      }
    }
  }
}

bool contains(const std::vector<std::string>& keys, const std::string& key) {
  return std::find(keys.begin(), keys.end(), key) != keys.end();
}

PlotPanel panel(const std::vector<FrontierPoint>& points, const Measure& measure, bool memory) {
  PlotPanel panel{.title = measure.title + (memory ? " against memory" : " against time"),
                  .x = {.label = memory ? "peak memory of the process, MiB" : "seconds an image", .logarithmic = true},
                  .y = {.label = measure.title},
                  .series = {{.name = "Pareto front", .points = {}, .line = true, .markers = false, .backdrop = true}}};
  for (const FrontierPoint& point : points) {
    const double x = cost_of(point.score, memory) / (memory ? kMebibyte : 1), y = *measure.of(point.score);
    auto series = std::find_if(panel.series.begin() + 1, panel.series.end(),
                               [&](const PlotSeries& s) { return s.name == point.score.name; });
    if (series == panel.series.end()) series = panel.series.insert(series, {point.score.name, {}, false});
    series->points.push_back({x, y, point.score.name + ", " + point.setting});
    if (contains(memory ? point.memory_fronts : point.time_fronts, measure.key))
      panel.series.front().points.push_back({x, y, {}});
  }
  // A staircase: between two points of the front, whoever pays for the cheaper one gets its error.
  std::vector<PlotPoint>& front = panel.series.front().points;
  std::sort(front.begin(), front.end(), [](const PlotPoint& a, const PlotPoint& b) { return a.x < b.x; });
  std::vector<PlotPoint> stairs;
  for (const PlotPoint& corner : front) {
    if (!stairs.empty()) stairs.push_back({corner.x, stairs.back().y, {}});
    stairs.push_back(corner);
  }
  front = stairs;
  return panel;
}

std::string frontier_svg(const std::vector<FrontierPoint>& points) {
  std::vector<PlotPanel> panels;
  for (const Measure& measure : measures(scores_of(points), {})) {
    if (measure.key != "rmse" && measure.key != "dssim" && measure.key != "flip") continue;
    for (const bool memory : {false, true}) panels.push_back(panel(points, measure, memory));
  }
  return svg_plots(panels, 2);
}

std::string frontier_csv(const std::vector<FrontierPoint>& points, const std::string& own_metric) {
  const std::vector<model::MethodScore> scores = scores_of(points);
  const std::vector<Measure> columns = measures(scores, own_metric);
  std::string csv = "method,setting,images";
  for (const Measure& column : columns) csv += "," + csv_field(column.key == "metric_model" ? own_metric : column.key);
  csv += ",seconds_per_image,peak_rss_bytes,time_fronts,memory_fronts\n";
  for (const FrontierPoint& point : points) {
    csv += csv_field(point.score.name) + "," + csv_field(point.setting) + "," + std::to_string(point.score.images);
    for (const Measure& column : columns) csv += "," + core::number_text(*column.of(point.score));
    csv += "," + core::number_text(point.score.seconds_per_image) + "," +
           (point.score.peak_rss_bytes ? std::to_string(*point.score.peak_rss_bytes) : "") + "," +
           core::joined(point.time_fronts, " ") + "," + core::joined(point.memory_fronts, " ") + "\n";
  }
  return csv;
}

}  // namespace

std::vector<FrontierPoint> measure_frontier(const std::vector<MethodChoice>& choices, const core::OlatScan& scan,
                                            const Protocol& protocol, const std::string& own_metric) {
  const double sharpness = model::default_sharpness(core::median_spacing_radians(scan.directions()));
  std::vector<FrontierPoint> points;
  for (const MethodChoice& choice : choices) {
    points.push_back({"default", protocol.evaluate(std::span(&choice, 1)).front(), {}, {}});
    for (const QualitySetting& setting : quality_settings(choice.method, sharpness)) {
      MethodChoice changed = choice;
      setting.apply(changed.options);
      try {
        points.push_back({setting.label, protocol.evaluate(std::span(&changed, 1)).front(), {}, {}});
      } catch (const core::UsageError& error) {
        core::note(choice.method + " with " + setting.label + " is left out: " + error.what());
      }
    }
  }
  mark_fronts(points, own_metric);
  return points;
}

ordered_json frontier_json(const std::string& scan, const Protocol& protocol, const std::vector<FrontierPoint>& points,
                           const std::string& own_metric) {
  ordered_json array = scores_json(scores_of(points), own_metric);
  ordered_json listed = ordered_json::array();
  for (std::size_t i = 0; i < points.size(); ++i) {
    ordered_json point{{"method", points[i].score.name}, {"setting", points[i].setting}};
    array[i].erase("name");
    array[i].erase("by_angle");
    point.update(array[i]);
    point["time_fronts"] = points[i].time_fronts;
    point["memory_fronts"] = points[i].memory_fronts;
    listed.push_back(std::move(point));
  }
  return {{"scan", scan}, {"protocol", protocol.name}, {"notes", protocol.notes}, {"points", listed}};
}

std::string frontier_text(const std::vector<FrontierPoint>& points) {
  const std::size_t all = measures(scores_of(points), {}).size();
  const auto named = [all](const std::vector<std::string>& keys) {
    return keys.size() == all ? "all measures" : core::joined(keys, " ");
  };
  std::vector<std::vector<std::string>> rows{
      {"method", "setting", "RMSE", "DSSIM", "FLIP", "s/image", "peak MiB", "cheapest for its error by"}};
  for (const FrontierPoint& point : points) {
    const model::MethodScore& score = point.score;
    std::string fronts;
    if (!point.time_fronts.empty()) fronts = "time: " + named(point.time_fronts);
    if (!point.memory_fronts.empty())
      fronts += (fronts.empty() ? "" : "; ") + ("memory: " + named(point.memory_fronts));
    rows.push_back({score.name, point.setting, fixed(score.rmse, 4), fixed(score.dssim, 4), fixed(score.flip, 4),
                    fixed(score.seconds_per_image, 4),
                    score.peak_rss_bytes ? fixed(double(*score.peak_rss_bytes) / kMebibyte, 0) : "-", fronts});
  }
  return table(rows);
}

void write_frontier(const std::filesystem::path& folder, const ordered_json& json,
                    const std::vector<FrontierPoint>& points, const std::string& own_metric) {
  core::write_file_atomically(folder / "frontier.json", json_text(json) + "\n");
  core::write_file_atomically(folder / "frontier.csv", frontier_csv(points, own_metric));
  core::write_file_atomically(folder / "frontier.svg", frontier_svg(points));
}

}  // namespace lightstage::cli
