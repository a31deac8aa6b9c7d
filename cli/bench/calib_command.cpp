#include "cli/bench/calib_command.h"

#include <memory>

#include <nlohmann/json.hpp>

#include "cli/bench/board_bench.h"
#include "cli/bench/calib_bench.h"
#include "cli/bench/exposure_bench.h"
#include "cli/format.h"
#include "cli/report/plot.h"
#include "core/file.h"

namespace lightstage::cli {

namespace {

using nlohmann::ordered_json;

struct Options {
  std::size_t lights = 110;
  int stages = 3;
  int ball_px = 150;
  std::filesystem::path data, out;
};

// The knobs that `calibrate` works with first, then what else there is.
std::vector<CalibKnobs> settings() {
  const CalibKnobs usual;
  std::vector<CalibKnobs> all{usual};
  for (const SpotMethod method : kSpotMethods) {
    for (const double clipping : {0.5, 3.0, 10.0, 30.0, 300.0}) {
      if (method == usual.method && clipping == usual.clipping) continue;
      all.push_back({.method = method, .clipping = clipping});
    }
  }
  for (const int cameras : {1, 2}) {
    for (const int balls : {1, 2, 3}) {
      if (balls == usual.balls && cameras == usual.cameras) continue;
      all.push_back({.balls = balls, .cameras = cameras});
    }
  }
  return all;
}

std::vector<std::string> cells_of(const CalibRow& row) {
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

std::string frontier_plot(const std::vector<CalibRow>& rows) {
  const PlotAxis seconds{"seconds for all lights", true};
  PlotPanel directions{"directions", seconds, {"median error, degrees", true}, {}};
  PlotPanel positions{"positions", seconds, {"median error, millimetres", true}, {}};
  for (const CalibRow& row : rows) {
    const CalibKnobs& k = row.knobs;
    const std::string name = std::string(name_of(k.method)) + ", " + std::to_string(k.balls) +
                             (k.balls == 1 ? " ball, " : " balls, ") + std::to_string(k.cameras) +
                             (k.cameras == 1 ? " camera" : " cameras");
    const std::string label = "clipped " + fixed(k.clipping, 1) + " times, " + std::to_string(row.ball_px) + " px";
    directions.series.push_back({name, {{row.seconds, row.median_degrees, label}}, false});
    positions.series.push_back({name, {{row.seconds, 1000 * row.median_m, label}}, false});
  }
  return svg_plots({directions, positions}, 2);
}

std::vector<std::string> cells_of(const BoardBenchRow& row) {
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

void run(const Options& options, Context& context) {
  if (!options.out.empty()) core::make_folder(options.out);
  const std::vector<CalibKnobs> knobs = settings();
  const CalibKnobs& usual = knobs.front();
  std::vector<std::unique_ptr<BallStage>> stages;
  std::vector<const BallStage*> judged;
  std::vector<PlacedLights> found;
  for (int s = 0; s < options.stages; ++s) {
    stages.push_back(std::make_unique<BallStage>(
        BallStageOptions{.lights = options.lights, .ball_px = options.ball_px, .seed = std::uint64_t(s) + 1}));
    judged.push_back(stages.back().get());
    found.push_back(place_lights(*stages.back(), usual));
  }
  const CalibRow all = judge(usual, judged, found);
  const GainRow gains = measure_gains(*stages.front(), found.front().bundle.lights);

  std::vector<CalibRow> rows;
  const auto add = [&](const BallStage& stage, const CalibKnobs& k) {
    rows.push_back(judge(k, {&stage}, {place_lights(stage, k)}));
  };
  for (const CalibKnobs& k : knobs) add(*stages.front(), k);
  for (const int ball_px : {options.ball_px / 4, options.ball_px / 2}) {
    const BallStage smaller({.lights = options.lights, .ball_px = ball_px, .seed = 1});
    for (const SpotMethod method : kSpotMethods) add(smaller, {.method = method});
  }

  ordered_json frontier = ordered_json::array();
  std::vector<std::vector<std::string>> cells{{"highlight", "clipped", "balls", "cameras", "ball px", "seconds",
                                               "placed", "median deg", "95 % deg", "median mm", "deg/sigma",
                                               "mm/sigma"}};
  for (const CalibRow& row : rows) {
    cells.push_back(cells_of(row));
    frontier.push_back(json_of(row));
  }
  std::vector<std::vector<std::string>> photograph_cells{
      {"photographs", "outline", "highlight", "lights", "mean deg", "largest", "from their joint"}};
  ordered_json photograph_rows = ordered_json::array();
  if (!options.data.empty()) {
    for (const PhotographRow& row : photographs(options.data)) {
      const bool two = row.to_joint_degrees > 0;
      photograph_cells.push_back({row.data, row.outline, std::string(name_of(row.method)), std::to_string(row.lights),
                                  fixed(row.mean_degrees, 3), fixed(row.largest_degrees, 3),
                                  two ? fixed(row.to_joint_degrees, 3) : "-"});
      photograph_rows.push_back({{"photographs", row.data},
                                 {"outline", row.outline},
                                 {"highlight", name_of(row.method)},
                                 {"lights", row.lights},
                                 {"mean_deg", row.mean_degrees},
                                 {"largest_deg", row.largest_degrees},
                                 {"mean_deg_to_joint", two ? ordered_json(row.to_joint_degrees) : ordered_json()}});
    }
  }
  const double hdr_percent = hdr_linearity_percent();
  std::vector<std::vector<std::string>> bracket_cells{{"exposures", "stops between", "read noise weight",
                                                       "exposure time", "merge s/Mvalue", "noise %", "off linear %"}};
  ordered_json brackets = ordered_json::array();
  for (const BracketRow& row : bracket_frontier()) {
    bracket_cells.push_back({std::to_string(row.knobs.exposures), fixed(row.knobs.stops_between, 1),
                             fixed(row.knobs.read_noise_share, 4), fixed(row.seconds, 1), fixed(row.merge_seconds, 3),
                             fixed(row.noise_percent, 2), fixed(row.largest_deviation_percent, 3)});
    brackets.push_back({{"knobs",
                         {{"exposures", row.knobs.exposures},
                          {"stops_between", row.knobs.stops_between},
                          {"read_noise_share", row.knobs.read_noise_share}}},
                        {"seconds", row.seconds},
                        {"merge_seconds", row.merge_seconds},
                        {"error", row.noise_percent},
                        {"largest_deviation_percent", row.largest_deviation_percent}});
  }
  std::vector<std::vector<std::string>> board_cells{{"views", "corners", "distortion", "seconds", "undistorted px",
                                                     "focal %", "principal px", "place mm", "turn deg"}};
  ordered_json boards = ordered_json::array();
  for (const BoardBenchRow& row : bench_boards()) {
    board_cells.push_back(cells_of(row));
    boards.push_back(json_of(row));
  }
  const ordered_json json{{"stages", options.stages},
                          {"lights", all.lights},
                          {"placed", all.placed},
                          {"median_deg", all.median_degrees},
                          {"p95_deg", all.p95_degrees},
                          {"median_position_mm", 1000 * all.median_m},
                          {"p95_position_mm", 1000 * all.p95_m},
                          {"direction_error_over_sigma", all.direction_ratio},
                          {"position_error_over_sigma", all.position_ratio},
                          {"gains",
                           {{"measured", gains.measured},
                            {"lights", gains.lights},
                            {"median_error", gains.median_error},
                            {"p95_error", gains.p95_error},
                            {"within_1_percent", gains.within_1_percent},
                            {"error_over_sigma", gains.ratio}}},
                          {"hdr_linearity_percent", hdr_percent},
                          {"photographs", photograph_rows},
                          {"frontier", frontier},
                          {"bracket_frontier", brackets},
                          {"board_frontier", boards}};
  std::string text =
      std::to_string(options.stages) + " simulated stages of " + std::to_string(options.lights) +
      " lights at 1.2 to 2.5 m, two mirror balls of " + std::to_string(options.ball_px) +
      " px in one camera with lens distortion, highlights clipped " + fixed(usual.clipping, 0) +
      " times, 12 bits and 40 dB\n  directions " + fixed(all.median_degrees, 3) + " degrees median, " +
      fixed(all.p95_degrees, 3) + " 95 %; positions " + fixed(1000 * all.median_m, 2) + " mm median, " +
      fixed(1000 * all.p95_m, 2) + " 95 %; " + std::to_string(all.placed) + " of " + std::to_string(all.lights) +
      " placed\n  errors over standard errors: directions " + fixed(all.direction_ratio, 2) + ", positions " +
      fixed(all.position_ratio, 2) + "\n  gains from a grey ball: " + fixed(100 * gains.median_error, 2) +
      " % median, " + fixed(100 * gains.p95_error, 2) + " % 95 %, " + fixed(100 * gains.within_1_percent, 1) +
      " % within 1 %; over standard errors " + fixed(gains.ratio, 2) + "; " + std::to_string(gains.measured) + " of " +
      std::to_string(gains.lights) + " measured\n  merged exposures: " + fixed(hdr_percent, 3) +
      " % from proportional at most, over 14 stops\n\n" + table(cells) + "\n" + table(bracket_cells) +
      "\nTwo cameras from rendered boards\n" + table(board_cells);
  if (photograph_cells.size() > 1) text += "\n" + table(photograph_cells);
  if (!options.out.empty()) {
    core::write_file_atomically(options.out / "calib.json", json.dump(1) + "\n");
    core::write_file_atomically(options.out / "calib.txt", text);
    core::write_file_atomically(options.out / "calib.svg", frontier_plot(rows));
    text += "\nwrote " + (options.out / "calib.json").string() + ", calib.txt and calib.svg\n";
  }
  context.result(text, json);
}

}  // namespace

void add_bench_calib(CLI::App& bench, Context& context) {
  const auto options = std::make_shared<Options>();
  CLI::App* command = bench.add_subcommand(
      "calib",
      "Calibration on simulated stages: errors of directions, positions and gains and whether their standard errors "
      "are "
      "honest; time against error of every highlight method, clipping, number of balls and cameras, and picture size");
  command->fallthrough();
  command->add_option("--lights", options->lights, "Lights of each stage")
      ->capture_default_str()
      ->check(CLI::Range(12, 4096));
  command->add_option("--stages", options->stages, "Stages, each of its own seed")
      ->capture_default_str()
      ->check(CLI::Range(1, 100));
  command->add_option("--ball-px", options->ball_px, "Radius of a ball's image, pixels")
      ->capture_default_str()
      ->check(CLI::Range(64, 1024));
  command
      ->add_option("--data", options->data,
                   "Also on photographs: a folder with psbox_two_mirror_balls and diligent_ball16, or one of them")
      ->check(CLI::ExistingDirectory);
  command->add_option("--out", options->out, "Also write the table, and a plot, into this folder");
  command->footer("Example:\n  lightstage bench calib --json");
  command->callback([options, &context] { run(*options, context); });
}

}  // namespace lightstage::cli
