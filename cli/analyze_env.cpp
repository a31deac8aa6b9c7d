#include <numeric>

#include <CLI/CLI.hpp>
#include <nlohmann/json.hpp>

#include "cli/commands.h"
#include "cli/format.h"
#include "cli/jobs/environments.h"
#include "cli/options.h"
#include "cli/report/plot.h"
#include "core/error.h"
#include "core/file.h"
#include "core/progress.h"
#include "relight/environment_analysis.h"

namespace lightstage::cli {

namespace {

struct Options {
  std::filesystem::path file, plot;
};

std::string percent(double share) {
  return fixed(100 * share, 1) + " %";
}

std::string verdict_in_words(relight::Verdict verdict) {
  switch (verdict) {
    case relight::Verdict::kLinear:
      return "linear: blending the captured lights suffices (degree 15 or less)";
    case relight::Verdict::kEither:
      return "either: super-resolution begins to pay between degrees 15 and 20";
    case relight::Verdict::kSuperResolution:
      break;
  }
  return "super_resolution: synthesised lights pay (degree 20 or more)";
}

// A dashed line from (x0, y0) to (x1, y1).
PlotSeries marked(const std::string& name, double x0, double y0, double x1, double y1) {
  return {.name = name, .points = {{x0, y0, {}}, {x1, y1, {}}}, .markers = false, .backdrop = true};
}

std::string spectrum_plot(const std::string& title, const relight::EnvironmentAnalysis& analysis) {
  constexpr double kRounding = 1e-14;  // of the whole: what is below it is no light
  const double all = std::accumulate(analysis.energy_by_degree.begin(), analysis.energy_by_degree.end(), 0.0);
  const double last = double(analysis.energy_by_degree.size() - 1);
  PlotSeries each{.name = "each degree", .points = {}}, held{.name = "up to each degree", .points = {}};
  double sum = 0;
  for (std::size_t l = 0; l < analysis.energy_by_degree.size(); ++l) {
    const double share = all > 0 ? analysis.energy_by_degree[l] / all : 0;
    const std::string degree = "degree " + std::to_string(l) + ": ";
    sum += share;
    if (share > kRounding) each.points.push_back({double(l), share, degree + percent(share)});
    held.points.push_back({double(l), sum, degree + percent(sum)});
  }
  const double at = analysis.degree_90;
  const PlotPanel spectrum{.title = title,
                           .x = {.label = "degree"},
                           .y = {.label = "share of the energy to degree 50", .logarithmic = true},
                           .series = {each}};
  const PlotPanel cumulative{
      .title = "90 % at degree " + std::to_string(analysis.degree_90) +
               "; above 50: " + percent(analysis.share_above_50) + " of all",
      .x = {.label = "degree"},
      .y = {.label = "share of the energy to degree 50"},
      .series = {held, marked("90 %", 0, 0.9, last, 0.9), marked("90 %", at, 0, at, 1),
                 marked("degrees 15, 20", 15, 0, 15, 1), marked("degrees 15, 20", 20, 0, 20, 1)}};
  return svg_plots({spectrum, cumulative}, 2);
}

void run_analyze_env(const Options& options, Context& context) {
  if (!options.plot.empty() && options.plot.extension() != ".svg")
    throw core::UsageError("--plot: '" + options.plot.string() + "' must end in .svg");
  const relight::Environment environment = read_environment(options.file);
  const relight::EnvironmentAnalysis analysis = relight::analyse(environment);
  if (!options.plot.empty())
    core::write_file_atomically(options.plot, spectrum_plot(options.file.filename().string(), analysis));

  const relight::SmallSources& sources = analysis.small_sources;
  std::string text = options.file.string() + ", " + std::to_string(environment.width()) + "x" +
                     std::to_string(environment.height()) + "\n90 % of the energy up to degree 50 is held by degree " +
                     std::to_string(analysis.degree_90) + " and those below; above degree 50 is " +
                     percent(analysis.share_above_50) + " of all energy\n" + verdict_in_words(analysis.verdict) +
                     "\nlight in small sources: " + percent(sources.share) + "\n";
  nlohmann::ordered_json brightest;
  if (sources.brightest) {
    const relight::LightSource& source = *sources.brightest;
    text += "the brightest: " + percent(source.share) + " from longitude " +
            fixed(source.direction.longitude_degrees(), 1) + ", latitude " +
            fixed(source.direction.latitude_degrees(), 1) + ", " + fixed(source.diameter_degrees, 2) +
            " degrees across\n";
    brightest = {{"longitude", source.direction.longitude_degrees()},
                 {"latitude", source.direction.latitude_degrees()},
                 {"diameter_deg", source.diameter_degrees},
                 {"share", source.share}};
  }
  nlohmann::ordered_json json{{"file", options.file.string()},
                              {"width", environment.width()},
                              {"height", environment.height()},
                              {"degree_90", analysis.degree_90},
                              {"energy_by_degree", analysis.energy_by_degree},
                              {"share_above_50", analysis.share_above_50},
                              {"verdict", relight::verdict_name(analysis.verdict)},
                              {"small_source_share", sources.share},
                              {"brightest_source", brightest}};
  if (!options.plot.empty()) {
    text += "wrote " + options.plot.string() + "\n";
    json["plot"] = options.plot.string();
  }
  context.result(text, json);
}

}  // namespace

void add_analyze_env(CLI::App& program, Context& context) {
  CLI::App* command = program.add_subcommand(
      "analyze-env", "How fine an environment's light is, and whether it needs super-resolution");
  command->footer(
      "The verdict is for a stage of 302 lights, by the degree of spherical harmonics up to which 90 % of the energy "
      "lies.\n"
      "Example:\n  lightstage analyze-env venice.hdr --plot venice.svg");
  auto options = std::make_shared<Options>();
  command->add_option("FILE", options->file, "Lat-long environment map (EXR or HDR)")->required();
  command->add_option("--plot", options->plot, "The .svg to write the energy of each degree to");
  command->callback([options, &context] { run_analyze_env(*options, context); });
}

}  // namespace lightstage::cli
