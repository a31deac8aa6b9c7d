#include <algorithm>
#include <map>

#include <CLI/CLI.hpp>
#include <nlohmann/json.hpp>

#include "cli/commands.h"
#include "cli/evaluate/arc.h"
#include "cli/evaluate/frontier.h"
#include "cli/evaluate/report.h"
#include "cli/evaluate/scores.h"
#include "cli/format.h"
#include "cli/jobs/method_options.h"
#include "cli/jobs/scans.h"
#include "cli/jobs/truth.h"
#include "cli/options.h"
#include "cli/report/contact_sheet.h"
#include "core/error.h"
#include "core/image_file.h"
#include "core/interrupt.h"
#include "core/progress.h"
#include "core/text.h"
#include "model/checkpoint.h"
#include "model/evaluation.h"
#include "model/learned_metric.h"

namespace lightstage::cli {

namespace {

using nlohmann::ordered_json;

struct Options {
  std::string name;
  bool held_out = false, off_grid = false, accuracy = false;
  int every = 1;
  std::size_t directions = 60;
  std::uint64_t seed = 1;
  bool linear = false, hdr_flip = false;
  std::filesystem::path metric_model;
  std::vector<std::size_t> subsample;
  std::filesystem::path sheet, report, frontier, arc;
  std::string arc_from, arc_to;
  int arc_steps = 60;
  MethodChoice method;
};

std::vector<std::string> split_names(const std::string& text) {
  std::vector<std::string> names;
  for (const std::string_view name : core::split(text, ',')) {
    if (!name.empty()) names.emplace_back(name);
  }
  return names;
}

// The methods asked for by name; without --method, or for `all`, all that can run: networks but blend only where there is a model.
std::vector<MethodChoice> chosen_methods(const Options& options, const db::Store& store, db::Id scan_id) {
  std::vector<std::string> names = split_names(options.method.method);
  std::map<model::Architecture, std::string> given;  // what each --model is for
  for (const std::string& file : split_names(options.method.model)) {
    const auto architecture = model::read_checkpoint_info(find_model(store, file)).config.architecture;
    const auto [other, is_new] = given.emplace(architecture, file);
    if (!is_new) {
      throw core::UsageError("--model: " + other->second + " and " + file + " are both for method " +
                             std::string(model::architecture_name(architecture)));
    }
  }
  if (names.empty() || names == std::vector<std::string>{"all"}) {
    names.clear();
    for (const model::MethodInfo& method : model::methods()) {
      const auto architecture = network_of(method.name);
      if (!architecture || architecture == model::Architecture::kBlend || given.contains(*architecture) ||
          newest_model(store, scan_id, {.architecture = architecture})) {
        names.push_back(method.name);
      } else {
        core::note(method.name + " is left out: no model of it was trained on this scan (give --model)");
      }
    }
  }
  for (const auto& [architecture, file] : given) {
    const std::string name(model::architecture_name(architecture));
    if (std::find(names.begin(), names.end(), name) == names.end()) {
      throw core::UsageError(file + " is a model for --method " + name + ", which is not among the methods");
    }
  }
  refuse_useless_knobs(options.method, names);
  std::vector<MethodChoice> choices;
  for (const std::string& name : names) {
    MethodChoice choice = for_method(options.method, name);
    const auto architecture = network_of(name);
    choice.model = architecture && given.contains(*architecture) ? given.at(*architecture) : "";
    choices.push_back(resolve(choice, store, scan_id));
  }
  return choices;
}

// Whether a model of this origin may have been trained on the lights 0, every, 2 every, ...; what it started from counts too. What
// cannot be understood may mean anything.
bool may_have_seen(const ordered_json& provenance, int every) {
  if (!provenance.is_object()) return true;
  const auto started_from = provenance.find("start_from");
  const bool from_scratch = started_from == provenance.end() || started_from->is_null() || *started_from == "";
  if (!from_scratch) {
    if (!started_from->is_object() || may_have_seen(started_from->value("provenance", ordered_json()), every))
      return true;
  }
  const auto data = provenance.find("data");
  const bool simulated_views_alone = data != provenance.end() && data->is_object();
  if (simulated_views_alone) return false;
  const auto held_out = provenance.find("held_out_every");
  if (held_out == provenance.end() || !held_out->is_number_integer()) return true;
  const auto held_out_every = held_out->get<std::int64_t>();
  return held_out_every <= 0 || every % held_out_every != 0;
}

// A network that has seen the very lights it is asked to predict would be flattered.
void warn_if_seen_in_training(const Options& options, const std::vector<MethodChoice>& choices) {
  for (const MethodChoice& choice : choices) {
    if (choice.options.model_file.empty()) continue;
    const std::string provenance = model::read_checkpoint_info(choice.options.model_file).provenance;
    if (may_have_seen(ordered_json::parse(provenance, nullptr, false), options.every)) {
      const std::string remedy = options.every == 1
                                     ? "train with --hold-out-every N and evaluate with --every N, N from 2"
                                     : "train with --hold-out-every " + std::to_string(options.every);
      core::warn(choice.method + " may have been trained on the lights held out here: its errors are flattered; " +
                 remedy);
    }
  }
}

// Which truths to show: some of the brighter half, in which there is something to see, from the brightest on.
std::vector<std::size_t> shown_rows(std::span<const core::Image> truth, std::size_t rows) {
  std::vector<std::pair<double, std::size_t>> by_brightness;
  for (std::size_t i = 0; i < truth.size(); ++i) {
    double sum = 0;
    for (const float value : truth[i].values()) sum += double(value);
    by_brightness.emplace_back(-sum, i);
  }
  std::sort(by_brightness.begin(), by_brightness.end());
  std::vector<std::size_t> shown;
  const std::size_t brighter_half = (truth.size() + 1) / 2;
  for (std::size_t r = 0; r < std::min(rows, brighter_half); ++r) {
    shown.push_back(by_brightness[r * brighter_half / std::min(rows, brighter_half)].second);
  }
  return shown;
}

// Truth, methods and differences.
void write_sheet(const std::filesystem::path& path, const core::OlatScan& scan,
                 const std::vector<MethodChoice>& choices, std::span<const core::Direction> directions,
                 std::span<const core::Image> truth, bool linear) {
  constexpr std::size_t kRows = 4;
  constexpr double kDifferenceGain = 4;
  std::vector<std::unique_ptr<model::LightInterpolator>> interpolators;
  for (const MethodChoice& choice : choices) {
    interpolators.push_back(model::make_interpolator(choice.method, scan, choice.options));
  }
  std::vector<std::vector<SheetCell>> rows;
  for (const std::size_t i : shown_rows(truth, kRows)) {
    core::throw_if_interrupted();
    const core::Image shown_truth = core::to_rgb(model::judged(truth[i], scan.exposure(), linear));
    std::vector<SheetCell> row{{shown_truth, "truth " + fixed(directions[i].longitude_degrees(), 0) + ", " +
                                                 fixed(directions[i].latitude_degrees(), 0) + " deg"}};
    std::vector<SheetCell> differences;
    for (const auto& interpolator : interpolators) {
      const core::Image shown =
          core::to_rgb(model::judged(interpolator->render(directions[i]), scan.exposure(), linear));
      differences.push_back({difference_picture(shown, shown_truth, kDifferenceGain),
                             std::string(interpolator->name()) + " error x" + fixed(kDifferenceGain, 0)});
      row.push_back({shown, std::string(interpolator->name())});
    }
    row.insert(row.end(), differences.begin(), differences.end());
    rows.push_back(std::move(row));
  }
  core::write_image(path, contact_sheet(rows), {.encoding = core::Encoding::kLinear});
}

// The measures that are asked for.
model::EvaluationOptions evaluation_options(const Options& options) {
  model::EvaluationOptions evaluation{.linear_values = options.linear, .hdr_flip = options.hdr_flip};
  if (!options.metric_model.empty()) {
    evaluation.own_metric = [metric = std::make_shared<const model::LearnedMetric>(options.metric_model)](
                                core::ImageView truth, core::ImageView picture, core::ImageView mask) {
      return (*metric)(truth, picture, mask);
    };
  }
  return evaluation;
}

std::string own_metric_name(const Options& options) {
  return options.metric_model.stem().string();
}

bool is_simulated(const db::Scan& scan) {
  return is_captured(scan) && capture_provenance(scan).simulation.has_value();
}

// The queries of --off-grid and their truth.
struct OffGrid {
  std::vector<core::Direction> directions;
  std::shared_ptr<const std::vector<core::Image>> truth;

  OffGrid(const Options& options, const SimulatedTruth& simulated, const db::LoadedScan& loaded)
      : directions(model::off_grid_directions(loaded.scan.directions(), options.directions, options.seed)) {
    core::note("rendering the truth for " + std::to_string(directions.size()) + " directions");
    truth = std::make_shared<const std::vector<core::Image>>(simulated.render(directions));
  }
};

void finish(const Options& options, const Context& context, Report report) {
  const bool several = report.stages.size() > 1 || report.protocol == "subsample";
  report.json = {
      {"scan", options.name}, {"protocol", report.protocol}, {"notes", report.stages.front().protocol.notes}};
  std::string ranking;
  for (const JudgedStage& stage : report.stages) {
    const ordered_json best = best_methods(stage.scores, report.own_metric);
    if (!best.empty()) {
      ranking +=
          (several ? std::to_string(stage.lights) + " lights: " : "") + best_in_words(best, report.own_metric) + "\n";
    }
    if (!several) {
      report.json["methods"] = scores_json(stage.scores, report.own_metric);
      report.json["best"] = best;
      continue;
    }
    report.json["stages"].push_back({{"lights", stage.lights},
                                     {"neighbours", model::published_neighbours(stage.lights)},
                                     {"methods", scores_json(stage.scores, report.own_metric)},
                                     {"best", best}});
  }
  std::string notes;
  for (const std::string& note : report.stages.front().protocol.notes) notes += note + "\n";
  if (!options.report.empty()) {
    write_report(options.report, report);
    report.json["report"] = (options.report / "index.html").string();
  }
  context.result("'" + options.name + "', " + report.protocol + ", " + (options.linear ? "linear" : "display-encoded") +
                     " values over the mask\n" + table(report_rows(report)) + ranking + notes,
                 report.json);
}

Report judge(const Options& options, const core::OlatScan& scan, const Protocol& protocol,
             std::vector<MethodChoice> choices) {
  std::vector<model::MethodScore> scores = protocol.evaluate(choices);
  return {.scan = options.name,
          .protocol = protocol.name,
          .linear_values = options.linear,
          .own_metric = own_metric_name(options),
          .stages = {{scan.light_count(), protocol, std::move(choices), std::move(scores)}},
          .json = {}};
}

void evaluate_off_grid(const Options& options, const db::Store& store, const db::LoadedScan& loaded, Context& context) {
  const SimulatedTruth simulated(store, options.name, {});
  const std::vector<MethodChoice> choices = chosen_methods(options, store, store.scan(options.name).id);
  const model::EvaluationOptions evaluation = evaluation_options(options);
  const OffGrid queries(options, simulated, loaded);
  const Protocol protocol = off_grid(loaded.scan, queries.directions, queries.truth, evaluation);
  Report report = judge(options, loaded.scan, protocol, choices);
  if (!options.sheet.empty())
    write_sheet(options.sheet, loaded.scan, choices, queries.directions, *queries.truth, options.linear);
  finish(options, context, std::move(report));
}

void evaluate_held_out(const Options& options, const db::Store& store, const db::LoadedScan& loaded, Context& context) {
  const std::vector<MethodChoice> choices = chosen_methods(options, store, store.scan(options.name).id);
  warn_if_seen_in_training(options, choices);
  const Protocol protocol = held_out(loaded.scan, options.every, evaluation_options(options));
  finish(options, context, judge(options, loaded.scan, protocol, choices));
}

void evaluate_subsample(const Options& options, const db::Store& store, const db::LoadedScan& loaded,
                        Context& context) {
  const std::vector<MethodChoice> choices = chosen_methods(options, store, store.scan(options.name).id);
  std::vector<std::size_t> stages = options.subsample;
  std::sort(stages.rbegin(), stages.rend());
  stages.erase(std::unique(stages.begin(), stages.end()), stages.end());
  for (const std::size_t lights : stages) {
    if (lights > loaded.scan.light_count()) {
      throw core::UsageError("--subsample: scan '" + options.name + "' has " +
                             std::to_string(loaded.scan.light_count()) + " lights, not " + std::to_string(lights));
    }
  }
  const model::EvaluationOptions evaluation = evaluation_options(options);
  const OffGrid queries(options, SimulatedTruth(store, options.name, {}), loaded);
  Report report;
  for (const std::size_t lights : stages) {
    const core::OlatScan scan = loaded.scan.with_lights(model::well_spread(loaded.scan.directions(), lights));
    std::vector<MethodChoice> thinned = choices;
    for (MethodChoice& choice : thinned) {
      choice.options.neighbours = model::published_neighbours(lights);
      choice.options.network.neighbours = model::published_neighbours(lights);
    }
    core::note(std::to_string(lights) + " lights, " + std::to_string(model::published_neighbours(lights)) +
               " neighbours");
    Protocol protocol = off_grid(scan, queries.directions, queries.truth, evaluation);
    protocol.notes.push_back(
        "Fewer lights are chosen as those farthest from the ones chosen before, from the front on; queries stay the "
        "same. "
        "linear and networks blend as many neighbours as published for a stage of that size; networks are not trained "
        "anew for it.");
    Report judged = judge(options, scan, protocol, std::move(thinned));
    judged.stages.insert(judged.stages.begin(), std::make_move_iterator(report.stages.begin()),
                         std::make_move_iterator(report.stages.end()));
    report = std::move(judged);
  }
  report.protocol = "subsample";
  finish(options, context, std::move(report));
}

// Judged off the grid where that can be, else by held-out lights, unless one of them is asked for.
void evaluate_frontier(const Options& options, const db::Store& store, const db::LoadedScan& loaded, Context& context) {
  const db::Scan scan = store.scan(options.name);
  const std::vector<MethodChoice> choices = chosen_methods(options, store, scan.id);
  const model::EvaluationOptions evaluation = evaluation_options(options);
  Protocol protocol;
  if (options.off_grid || (!options.held_out && is_simulated(scan))) {
    const OffGrid queries(options, SimulatedTruth(store, options.name, {}), loaded);
    protocol = off_grid(loaded.scan, queries.directions, queries.truth, evaluation);
  } else {
    warn_if_seen_in_training(options, choices);
    protocol = held_out(loaded.scan, options.every, evaluation);
  }
  const std::string own_metric = own_metric_name(options);
  const std::vector<FrontierPoint> points = measure_frontier(choices, loaded.scan, protocol, own_metric);
  const ordered_json json = frontier_json(options.name, protocol, points, own_metric);
  write_frontier(options.frontier, json, points, own_metric);
  context.result("'" + options.name + "', frontier, " + protocol.name + "\n" + frontier_text(points) + "written to " +
                     options.frontier.string() + "\n",
                 json);
}

void evaluate_arc(const Options& options, const db::Store& store, const db::LoadedScan& loaded, Context& context) {
  const db::Scan scan = store.scan(options.name);
  const std::vector<MethodChoice> choices = chosen_methods(options, store, scan.id);
  if (options.arc_from.empty() != options.arc_to.empty()) throw core::UsageError("--from and --to go together");
  Arc arc;
  if (options.arc_from.empty()) {
    arc = arc_between_lights(loaded.scan.directions());
  } else {
    arc = {.from = direction_option("--from", options.arc_from), .to = direction_option("--to", options.arc_to)};
    if (!(arc.degrees() > 0.01 && arc.degrees() < 179.9))
      throw core::UsageError("--from and --to must be between 0.01 and 179.9 degrees apart");
  }
  arc.steps = options.arc_steps;
  std::vector<core::Image> truth;
  if (is_simulated(scan)) {
    core::note("rendering the truth along the arc");
    truth = SimulatedTruth(store, options.name, {}).render(arc.directions());
  }
  const ArcResult result = judge_along_arc(loaded.scan, choices, arc, std::move(truth), options.linear);
  write_arc(options.arc, options.name, result);
  context.result("'" + options.name + "', along an arc of " + fixed(arc.degrees(), 1) + " degrees\n" +
                     arc_text(result) + "written to " + options.arc.string() + "\n",
                 arc_json(options.name, result));
}

void evaluate_accuracy(const Options& options, const db::Store& store, const db::LoadedScan& loaded, Context& context) {
  const SimulatedTruth truth(store, options.name, {});
  const auto calibration = truth.calibration_error(loaded);
  const auto alignment = truth.alignment_error(store, loaded.scan.exposure());
  context.result("'" + options.name + "' against the simulator's truth\n" +
                     table({{"light directions", fixed(calibration.median_degrees, 3) + " deg median",
                             fixed(calibration.p95_degrees, 3) + " deg 95 %",
                             fixed(calibration.largest_degrees, 3) + " deg at most"},
                            {"light gains", fixed(100 * calibration.median_gain_error, 2) + " % median"},
                            {"alignment", fixed(alignment.median_epe_px, 3) + " px median",
                             fixed(alignment.p95_epe_px, 3) + " px 95 %"},
                            {"PSNR", fixed(alignment.psnr_unaligned_db, 2) + " dB unaligned",
                             fixed(alignment.psnr_aligned_db, 2) + " dB aligned"}}),
                 {{"scan", options.name},
                  {"calibration",
                   {{"lights", calibration.lights},
                    {"median_deg", calibration.median_degrees},
                    {"p95_deg", calibration.p95_degrees},
                    {"largest_deg", calibration.largest_degrees},
                    {"median_gain_error", calibration.median_gain_error}}},
                  {"alignment",
                   {{"frames", alignment.frames},
                    {"median_epe_px", alignment.median_epe_px},
                    {"p95_epe_px", alignment.p95_epe_px},
                    {"psnr_unaligned_db", alignment.psnr_unaligned_db},
                    {"psnr_aligned_db", alignment.psnr_aligned_db}}}});
}

// Options that the chosen protocol would not heed.
void refuse_useless(const Options& options) {
  const bool subsample = !options.subsample.empty(), frontier = !options.frontier.empty(), arc = !options.arc.empty();
  const int protocols = int(options.accuracy) + int(subsample) + int(frontier) + int(arc) +
                        (frontier ? 0 : int(options.held_out) + int(options.off_grid));
  if (protocols != 1 || (options.held_out && options.off_grid)) {
    throw core::UsageError("give one of --held-out, --off-grid, --subsample, --frontier, --arc and --accuracy");
  }
  if (!options.sheet.empty() && (!options.off_grid || frontier)) throw core::UsageError("--sheet goes with --off-grid");
  if (!options.report.empty() && (options.accuracy || frontier || arc))
    throw core::UsageError("--report goes with --held-out, --off-grid and --subsample");
  if ((options.hdr_flip || !options.metric_model.empty()) && (options.accuracy || arc))
    throw core::UsageError("--hdr-flip and --metric-model go with --held-out, --off-grid, --subsample and --frontier");
  if (subsample && options.method.knobs.contains("--neighbours"))
    throw core::UsageError(
        "--subsample blends as many neighbours as published for each number of lights; leave out --neighbours");
  if (!arc && (!options.arc_from.empty() || !options.arc_to.empty()))
    throw core::UsageError("--from and --to go with --arc");
}

void run_evaluate(const Options& options, Context& context) {
  refuse_useless(options);
  const db::Store store = context.open_store();
  const db::LoadedScan loaded = load_scan(store, options.name);
  for (const std::filesystem::path& folder : {options.report, options.frontier, options.arc}) {
    if (!folder.empty()) make_folder(folder);
  }
  if (!options.frontier.empty()) {
    evaluate_frontier(options, store, loaded, context);
  } else if (!options.arc.empty()) {
    evaluate_arc(options, store, loaded, context);
  } else if (!options.subsample.empty()) {
    evaluate_subsample(options, store, loaded, context);
  } else if (options.off_grid) {
    evaluate_off_grid(options, store, loaded, context);
  } else if (options.held_out) {
    evaluate_held_out(options, store, loaded, context);
  } else {
    evaluate_accuracy(options, store, loaded, context);
  }
}

}  // namespace

void add_evaluate(CLI::App& program, Context& context) {
  CLI::App* command = program.add_subcommand("evaluate", "Measure and rank methods on a scan");
  command->footer(
      "Examples:\n"
      "  lightstage evaluate head --off-grid --directions 60 --method blend,rbf,linear\n"
      "  lightstage evaluate lion --held-out --every 4\n"
      "  lightstage evaluate head --off-grid --method all --report report\n"
      "  lightstage evaluate head --subsample 302,250,200,150,100 --method blend,rbf,linear --report fewer\n"
      "  lightstage evaluate head --frontier frontier\n"
      "  lightstage evaluate head --arc arc --method blend,rbf,linear\n"
      "  lightstage evaluate head --accuracy       (calibration and alignment; simulated scans)");
  auto options = std::make_shared<Options>();
  command->add_option("SCAN", options->name, "The scan")->required();
  command->add_flag("--held-out", options->held_out, "Leave each light out in turn and predict it from the others");
  command->add_flag("--off-grid", options->off_grid,
                    "Predict directions where no light stands, against the simulator's truth (simulated scans)");
  command
      ->add_option(
          "--subsample", options->subsample,
          "Off grid with fewer lights, well spread: their numbers, separated by commas; 302,250,200,150,100 as "
          "published")
      ->delimiter(',')
      ->check(CLI::Range(1, 100000));
  command->add_option(
      "--frontier", options->frontier,
      "Time and memory against error, for every method and each of its quality settings: writes "
      "frontier.json, .csv and .svg into this folder (off grid for simulated scans, else held out, or as "
      "chosen)");
  command->add_option(
      "--arc", options->arc,
      "How smoothly pictures change as the light moves from one light over the next and as far beyond: writes "
      "a strip of one row over time for each method and a page into this folder");
  command->add_option("--from", options->arc_from, "Arc: its start instead, x,y,z or longitude,latitude");
  command->add_option("--to", options->arc_to, "Arc: its end instead");
  command->add_option("--steps", options->arc_steps, "Arc: steps from frame to frame")
      ->capture_default_str()
      ->check(CLI::Range(2, 100000));
  command->add_flag("--accuracy", options->accuracy,
                    "Errors of calibration and alignment against the simulator's truth (simulated scans)");
  command->add_option("--every", options->every, "Held out: only every n-th light")
      ->capture_default_str()
      ->check(CLI::Range(1, 100000));
  command->add_option("--directions", options->directions, "Off grid: number of random directions")
      ->capture_default_str()
      ->check(CLI::Range(1, 100000));
  command->add_option("--seed", options->seed, "Off grid: seed of the directions")
      ->capture_default_str()
      ->check(CLI::NonNegativeNumber);
  command->add_flag("--linear", options->linear, "Judge linear values instead of display-encoded ones");
  command->add_option("--sheet", options->sheet,
                      "Off grid: write a contact sheet of truth, methods and differences (.png)");
  command->add_flag("--hdr-flip", options->hdr_flip, "Also HDR-FLIP, which takes about ten times as long as FLIP");
  command->add_option(
      "--metric-model", options->metric_model,
      "Also a measure of your own: a TorchScript file (a program, which is run) whose forward takes two "
      "display-encoded pictures [1, 3, height, width] in [0, 1] and returns a number; reported under the file's "
      "name");
  command->add_option(
      "--report", options->report,
      "Write tables (JSON, CSV, Markdown), plots and a page with the crops in which methods differ most into "
      "this folder");
  add_method_options(*command, options->method,
                     "Methods, separated by commas, or all [all; those that need training if the scan has a model]");
  command->get_option("--model")->description(
      "Model files or names, separated by commas, at most one for each network [the newest trained on the scan; "
      "blend has one from the start]");
  command->callback([options, &context] { run_evaluate(*options, context); });
}

}  // namespace lightstage::cli
