#include "cli/bench/relight_command.h"

#include <algorithm>
#include <memory>
#include <optional>

#include <CLI/CLI.hpp>
#include <nlohmann/json.hpp>

#include "cli/bench/relight_bench.h"
#include "cli/format.h"
#include "cli/report/plot.h"
#include "core/file.h"
#include "core/text.h"
#include "model/methods.h"
#include "model/shipped_model.h"

namespace lightstage::cli {

namespace {

using nlohmann::ordered_json;

const std::vector<double> kAsked{0.02, 0.005, 0.002, 0.0005};  // DSSIM
const std::vector<std::size_t> kStages{302, 150, 100};
const std::vector<double> kRadii{0, 1, 2, 5, 10, 20, 30};
const std::vector<int> kDegrees{0, 5, 10, 15, 20, 30, 51};  // ends of the bins

struct Options {
  SimulatedStageOptions stage;
  std::vector<std::filesystem::path> environments;
  int map_height = 32;
  std::size_t directions = 1024;
  std::filesystem::path out;
};

std::string times(double ratio) {
  return fixed(ratio, ratio < 10 ? 1 : 0);
}

double ratio_of(double more, double fewer) {
  return fewer > 0 ? more / fewer : 0;
}

std::string count_ratio(std::size_t exhaustive, std::size_t synthesised) {
  return synthesised == 0 ? "none needed" : times(double(exhaustive) / double(synthesised));
}

void add_matched(const MatchedTable& table_of, std::string& text, ordered_json& json) {
  std::vector<std::vector<std::string>> rows{{"environment", "degree", "asked", "estimated", "reached", "pictures",
                                              "of", "s", "of", "times faster", "at 256x128", "times fewer",
                                              "times faster"}};
  ordered_json all = ordered_json::array();
  for (const MatchedRow& row : table_of.rows) {
    const double full_s = double(row.lit_of_full) * table_of.seconds_per_picture;
    rows.push_back({row.environment, std::to_string(row.degree_90), core::number_text(row.asked, 2),
                    core::number_text(row.dssim_estimate, 2), core::number_text(row.dssim, 2),
                    std::to_string(row.synthesised), std::to_string(row.exhaustive), fixed(row.planned_s, 2),
                    fixed(row.exhaustive_s, 0), times(ratio_of(row.exhaustive_s, row.planned_s)),
                    std::to_string(row.synthesised_of_full), count_ratio(row.lit_of_full, row.synthesised_of_full),
                    times(ratio_of(full_s, row.planned_of_full_s))});
    all.push_back({{"environment", row.environment},
                   {"degree_90", row.degree_90},
                   {"asked_dssim", row.asked},
                   {"dssim_estimate", row.dssim_estimate},
                   {"dssim", row.dssim},
                   {"relative_rms", row.relative_rms},
                   {"directions_exhaustive", row.exhaustive},
                   {"directions_synthesised", row.synthesised},
                   {"exhaustive_s", row.exhaustive_s},
                   {"planned_s", row.planned_s},
                   {"full_directions_exhaustive", row.lit_of_full},
                   {"full_directions_synthesised", row.synthesised_of_full},
                   {"full_planned_s", row.planned_of_full_s},
                   {"full_exhaustive_s_extrapolated", full_s}});
  }
  text +=
      "By plan against exhaustive synthesis (DSSIM; the last three columns for maps of 256x128, their exhaustive time "
      "extrapolated from " +
      fixed(table_of.seconds_per_picture, 3) + " s a picture)\n" + table(rows) + "\n";
  json["seconds_per_picture"] = table_of.seconds_per_picture;
  json["matched"] = all;
}

void add_gains(const std::vector<GainRow>& gained, std::string& text, ordered_json& json) {
  std::vector<std::vector<std::string>> rows{{"lights", "degree", "environments", "between them", "network from truth",
                                              "linear from truth", "linear over network"}};
  for (const std::size_t lights : kStages) {
    for (std::size_t bin = 0; bin + 1 < kDegrees.size(); ++bin) {
      double between = 0, network = 0, linear = 0;
      std::size_t count = 0;
      for (const GainRow& row : gained) {
        if (row.lights != lights || row.degree_90 < kDegrees[bin] || row.degree_90 >= kDegrees[bin + 1]) continue;
        between += row.between;
        network += row.network_error;
        linear += row.linear_error;
        ++count;
      }
      if (count == 0) continue;
      const double n = double(count);
      rows.push_back({std::to_string(lights),
                      std::to_string(kDegrees[bin]) + " to " + std::to_string(kDegrees[bin + 1] - 1),
                      std::to_string(count), fixed(between / n, 5), fixed(network / n, 5), fixed(linear / n, 5),
                      times(ratio_of(linear, network))});
    }
  }
  ordered_json all = ordered_json::array();
  for (const GainRow& row : gained)
    all.push_back({{"environment", row.environment},
                   {"lights", row.lights},
                   {"degree_90", row.degree_90},
                   {"dssim_between", row.between},
                   {"dssim_network_truth", row.network_error},
                   {"dssim_linear_truth", row.linear_error}});
  text += "Super-resolution against linear blending, by the degree that holds 90 % of the energy (mean DSSIM)\n" +
          table(rows) + "\n";
  json["gains"] = all;
}

void add_shadows(const std::vector<ShadowRow>& shadows, std::string& text, ordered_json& json) {
  std::vector<std::vector<std::string>> rows{
      {"radius, deg", "synthesised", "network RMSE", "linear RMSE", "network DSSIM", "linear DSSIM"}};
  ordered_json all = ordered_json::array();
  for (const ShadowRow& row : shadows) {
    rows.push_back({fixed(row.radius_degrees, 0), std::to_string(row.synthesised), fixed(row.network_rmse, 4),
                    fixed(row.linear_rmse, 4), fixed(row.network_dssim, 5), fixed(row.linear_dssim, 5)});
    all.push_back({{"radius_deg", row.radius_degrees},
                   {"directions_synthesised", row.synthesised},
                   {"network_rmse", row.network_rmse},
                   {"linear_rmse", row.linear_rmse},
                   {"network_dssim", row.network_dssim},
                   {"linear_dssim", row.linear_dssim}});
  }
  text += "Area lights against the simulator's\n" + table(rows);
  json["shadows"] = all;
}

std::string gains_plot(const std::vector<GainRow>& gained) {
  std::vector<PlotPanel> panels;
  for (const std::size_t lights : kStages) {
    PlotSeries between{"between network and linear", {}, false}, network{"network from truth", {}, false},
        linear{"linear from truth", {}, false};
    for (const GainRow& row : gained) {
      if (row.lights != lights) continue;
      const double degree = double(row.degree_90);
      between.points.push_back({degree, row.between, row.environment});
      network.points.push_back({degree, row.network_error, row.environment});
      linear.points.push_back({degree, row.linear_error, row.environment});
    }
    panels.push_back({std::to_string(lights) + " lights",
                      {"degree that holds 90 % of the energy", false},
                      {"DSSIM", true},
                      {between, network, linear}});
  }
  return svg_plots(panels, int(panels.size()));
}

std::string frontier_plot(const MatchedTable& matched) {
  constexpr double kExact = 1e-6;  // where no error is drawn
  PlotPanel panel{
      "by plan; the last points exhaustive, at 1e-6", {"seconds", true}, {"DSSIM from exhaustive synthesis", true}, {}};
  for (std::size_t i = 0; i < matched.rows.size(); ++i) {
    const MatchedRow& row = matched.rows[i];
    if (i == 0 || row.environment != matched.rows[i - 1].environment) panel.series.push_back({row.environment, {}});
    std::vector<PlotPoint>& points = panel.series.back().points;
    points.push_back({row.planned_s, std::max(row.dssim, kExact), std::to_string(row.synthesised) + " pictures"});
    if (i + 1 == matched.rows.size() || matched.rows[i + 1].environment != row.environment)
      points.push_back({row.exhaustive_s, kExact, "all " + std::to_string(row.exhaustive) + " pictures"});
  }
  return svg_plots({panel}, 1);
}

void run(const Options& options, Context& context) {
  if (!options.out.empty()) core::make_folder(options.out);
  const std::vector<NamedEnvironment> environments = bench_environments(options.environments);
  const SimulatedStage stage(options.stage);
  model::MethodOptions method_options;
  method_options.model_file = model::shipped_blend();
  const auto network = model::make_interpolator("blend", stage.scan(), method_options);

  const MatchedTable matched =
      matched_errors(*network, environments, 2 * options.map_height, options.map_height, kAsked);
  const std::vector<GainRow> gained = gains(options.stage, kStages, environments, options.directions);
  const std::vector<ShadowRow> shadows = soft_shadows(stage, *network, kRadii);

  std::string text;
  ordered_json json{{"lights", options.stage.lights},
                    {"pixels", options.stage.pixels},
                    {"map", std::to_string(2 * options.map_height) + "x" + std::to_string(options.map_height)}};
  add_matched(matched, text, json);
  add_gains(gained, text, json);
  add_shadows(shadows, text, json);
  if (!options.out.empty()) {
    core::write_file_atomically(options.out / "relight.json", json.dump(1) + "\n");
    core::write_file_atomically(options.out / "relight.txt", text);
    core::write_file_atomically(options.out / "gains.svg", gains_plot(gained));
    core::write_file_atomically(options.out / "frontier.svg", frontier_plot(matched));
    text += "\nwrote " + (options.out / "relight.json").string() + ", relight.txt, gains.svg and frontier.svg\n";
  }
  context.result(text, json);
}

}  // namespace

void add_bench_relight(CLI::App& bench, Context& context) {
  const auto options = std::make_shared<Options>();
  CLI::App* command = bench.add_subcommand(
      "relight",
      "Relighting by plan on a simulated stage: pictures, time and error against exhaustive synthesis; what "
      "super-resolution gains over blending; soft shadows");
  command->fallthrough();
  command->add_option("--env", options->environments, "Further environment maps (EXR or HDR)");
  command->add_option("--lights", options->stage.lights, "Lights of the stage")
      ->capture_default_str()
      ->check(CLI::Range(30, 4096));
  command->add_option("--size", options->stage.pixels, "Pixels a side of the square picture")
      ->capture_default_str()
      ->check(CLI::Range(16, 2048));
  command->add_option("--mesh", options->stage.mesh, "A head mesh instead of the procedural head");
  command
      ->add_option("--map-height", options->map_height,
                   "Rows of the maps that are synthesised exhaustively, twice as many columns: 128 is the published "
                   "size, and takes "
                   "hours")
      ->capture_default_str()
      ->check(CLI::Range(2, 1024));
  command->add_option("--directions", options->directions, "Directions of the comparison with linear blending")
      ->capture_default_str()
      ->check(CLI::Range(16, 100000));
  command->add_option("--out", options->out, "Also write the tables, and plots, into this folder");
  command->footer("Example:\n  lightstage bench relight --env venice.hdr --out relight-bench");
  command->callback([options, &context] { run(*options, context); });
}

}  // namespace lightstage::cli
