#include "cli/bench/calib_report.h"

#include <algorithm>
#include <cmath>

#include "cli/format.h"
#include "cli/report/plot.h"
#include "core/text.h"

namespace lightstage::cli {

namespace {

using nlohmann::ordered_json;
using Cells = std::vector<std::string>;

Cells cells_of(const CalibRow& row) {
  return {std::string(name_of(row.knobs.method)),
          fixed(row.knobs.clipping, 1),
          std::to_string(row.knobs.balls),
          std::to_string(row.knobs.cameras),
          std::to_string(row.ball_px),
          fixed(row.seconds, 2),
          std::to_string(row.placed) + "/" + std::to_string(row.lights),
          fixed(row.median_degrees, 3),
          fixed(row.p95_degrees, 3),
          fixed(1000 * row.median_m, 2),
          fixed(row.direction_ratio, 2),
          fixed(row.position_ratio, 2)};
}

ordered_json json_of(const CalibRow& row) {
  return {{"knobs",
           {{"highlight", name_of(row.knobs.method)},
            {"clipping", row.knobs.clipping},
            {"balls", row.knobs.balls},
            {"cameras", row.knobs.cameras},
            {"ball_px", row.ball_px}}},
          {"seconds", row.seconds},
          {"error", row.median_degrees},
          {"p95_error", row.p95_degrees},
          {"position_mm", 1000 * row.median_m},
          {"direction_error_over_sigma", row.direction_ratio},
          {"position_error_over_sigma", row.position_ratio},
          {"placed", row.placed},
          {"lights", row.lights}};
}

// Of two balls alone; one against known lights has no joint direction.
bool is_joint(const PhotographRow& row) {
  return row.to_joint_degrees > 0;
}

Cells cells_of(const PhotographRow& row) {
  return {row.data,
          row.outline,
          std::string(name_of(row.method)),
          std::to_string(row.lights),
          fixed(row.mean_degrees, 3),
          fixed(row.largest_degrees, 3),
          is_joint(row) ? fixed(row.to_joint_degrees, 3) : "-"};
}

ordered_json json_of(const PhotographRow& row) {
  return {{"photographs", row.data},
          {"outline", row.outline},
          {"highlight", name_of(row.method)},
          {"lights", row.lights},
          {"mean_deg", row.mean_degrees},
          {"largest_deg", row.largest_degrees},
          {"mean_deg_to_joint", is_joint(row) ? ordered_json(row.to_joint_degrees) : ordered_json()}};
}

Cells cells_of(const BracketRow& row) {
  return {std::to_string(row.knobs.exposures),
          fixed(row.knobs.stops_between, 1),
          fixed(row.knobs.read_noise_share, 3),
          fixed(row.seconds, 0),
          fixed(row.merge_seconds, 3),
          fixed(row.noise_percent, 2),
          fixed(row.largest_deviation_percent, 3)};
}

ordered_json json_of(const BracketRow& row) {
  return {{"knobs",
           {{"exposures", row.knobs.exposures},
            {"stops_between", row.knobs.stops_between},
            {"read_noise_share", row.knobs.read_noise_share}}},
          {"seconds", row.seconds},
          {"merge_seconds", row.merge_seconds},
          {"error", row.noise_percent},
          {"largest_deviation_percent", row.largest_deviation_percent}};
}

Cells cells_of(const BoardBenchRow& row) {
  if (!row.refused.empty()) return {std::to_string(row.views), row.corners, row.distortion, row.refused};
  return {std::to_string(row.views),
          row.corners,
          row.distortion,
          fixed(row.seconds, 1),
          fixed(row.undistorted_px, 3),
          fixed(row.focal_percent, 3),
          fixed(row.principal_px, 2),
          fixed(row.position_mm, 2),
          fixed(row.rotation_degrees, 3)};
}

ordered_json json_of(const BoardBenchRow& row) {
  ordered_json object{{"knobs", {{"views", row.views}, {"corners", row.corners}, {"distortion", row.distortion}}},
                      {"seconds", row.seconds}};
  if (!row.refused.empty()) {
    object["refused"] = row.refused;
    return object;
  }
  object["error"] = row.undistorted_px;
  object["focal_percent"] = row.focal_percent;
  object["principal_px"] = row.principal_px;
  object["position_mm"] = row.position_mm;
  object["rotation_deg"] = row.rotation_degrees;
  return object;
}

template <typename Row>
RowsReport rows_report(const Cells& head, const std::vector<Row>& rows) {
  RowsReport report;
  std::vector<Cells> cells{head};
  for (const Row& row : rows) {
    cells.push_back(cells_of(row));
    report.json.push_back(json_of(row));
  }
  if (!rows.empty()) report.text = table(cells);
  return report;
}

// Adds the point to the series of that name, which is made where there is none yet.
void add_point(PlotPanel& panel, const std::string& series, bool line, PlotPoint point) {
  for (PlotSeries& known : panel.series) {
    if (known.name == series) {
      known.points.push_back(std::move(point));
      return;
    }
  }
  panel.series.push_back({series, {std::move(point)}, line});
}

}  // namespace

RowsReport report(const std::vector<CalibRow>& rows) {
  return rows_report({"highlight", "clipped", "balls", "cameras", "ball px", "seconds", "placed", "median deg",
                      "95 % deg", "median mm", "deg/sigma", "mm/sigma"},
                     rows);
}

RowsReport report(const std::vector<PhotographRow>& rows) {
  return rows_report({"photographs", "outline", "highlight", "lights", "mean deg", "largest", "from their joint"},
                     rows);
}

RowsReport report(const std::vector<BracketRow>& rows) {
  return rows_report(
      {"exposures", "stops between", "read noise weight", "exposure time", "merge s/Mvalue", "noise %", "off linear %"},
      rows);
}

RowsReport report(const std::vector<BoardBenchRow>& rows) {
  return rows_report({"views", "corners", "distortion", "seconds", "undistorted px", "focal %", "principal px",
                      "place mm", "turn deg"},
                     rows);
}

std::string frontier_plot(const std::vector<CalibRow>& lights, const std::vector<BracketRow>& brackets,
                          const std::vector<BoardBenchRow>& boards) {
  const PlotAxis seconds{"seconds for all lights", true}, degrees{"median error, degrees", true};
  PlotPanel methods{"highlight method, clipped 0.5 to 300 times", seconds, degrees, {}};
  PlotPanel sizes{"size of a ball's image", seconds, degrees, {}};
  PlotPanel views{"balls and cameras: directions", seconds, degrees, {}};
  PlotPanel places{"balls and cameras: positions", seconds, {"median error, millimetres", true}, {}};
  const CalibKnobs usual;
  int largest_px = 0;
  for (const CalibRow& row : lights) largest_px = std::max(largest_px, row.ball_px);
  for (const CalibRow& row : lights) {
    const CalibKnobs& k = row.knobs;
    const std::string name(name_of(k.method));
    const bool usual_views = k.balls == usual.balls && k.cameras == usual.cameras,
               usual_size = row.ball_px == largest_px;
    const bool usual_clipping = k.clipping == usual.clipping;
    if (usual_views && usual_size) {
      add_point(methods, name, false, {row.seconds, row.median_degrees, "clipped " + fixed(k.clipping, 1) + " times"});
    }
    if (usual_views && usual_clipping) {
      add_point(sizes, name, false, {row.seconds, row.median_degrees, std::to_string(row.ball_px) + " px"});
    }
    if (k.method == usual.method && usual_clipping && usual_size) {
      const std::string seen =
          core::counted(std::size_t(k.balls), "ball") + ", " + core::counted(std::size_t(k.cameras), "camera");
      add_point(views, seen, false, {row.seconds, row.median_degrees, seen});
      add_point(places, seen, false, {row.seconds, 1000 * row.median_m, seen});
    }
  }
  PlotPanel merged{"exposures merged", {"exposure time, shortest = 1", true}, {"noise over 14 stops, %", true}, {}};
  for (const BracketRow& row : brackets) {
    if (row.knobs.read_noise_share != BracketKnobs().read_noise_share) continue;
    add_point(merged, core::counted(std::size_t(std::lround(row.knobs.stops_between)), "stop") + " between", true,
              {row.seconds, row.noise_percent, core::counted(std::size_t(row.knobs.exposures), "exposure")});
  }
  PlotPanel rigs{"cameras from boards", {"seconds for all views", true}, {"undistorted, px (rms)", true}, {}};
  for (const BoardBenchRow& row : boards) {
    const bool usual_terms = row.distortion == boards.front().distortion;
    add_point(rigs, row.corners + (usual_terms ? "" : ", other distortion"), false,
              {row.seconds, row.undistorted_px, core::counted(std::size_t(row.views), "view") + ", " + row.distortion});
  }
  return svg_plots({methods, sizes, views, places, merged, rigs}, 2);
}

}  // namespace lightstage::cli
