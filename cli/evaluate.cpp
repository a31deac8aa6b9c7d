#include <algorithm>

#include <CLI/CLI.hpp>
#include <nlohmann/json.hpp>

#include "cli/commands.h"
#include "cli/evaluate/arc.h"
#include "cli/evaluate/choices.h"
#include "cli/evaluate/frontier.h"
#include "cli/evaluate/report.h"
#include "cli/evaluate/scores.h"
#include "cli/evaluate/sheet.h"
#include "cli/format.h"
#include "cli/jobs/method_options.h"
#include "cli/jobs/scans.h"
#include "cli/jobs/truth.h"
#include "cli/options.h"
#include "cli/seed_option.h"
#include "core/error.h"
#include "core/file.h"
#include "core/progress.h"
#include "core/text.h"
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
  const std::vector<MethodChoice> choices = chosen_methods(options.method, store, store.scan(options.name).id);
  const model::EvaluationOptions evaluation = evaluation_options(options);
  const OffGrid queries(options, simulated, loaded);
  const Protocol protocol = off_grid(loaded.scan, queries.directions, queries.truth, evaluation);
  Report report = judge(options, loaded.scan, protocol, choices);
  if (!options.sheet.empty())
    write_sheet(options.sheet, loaded.scan, choices, queries.directions, *queries.truth, options.linear);
  finish(options, context, std::move(report));
}

void evaluate_held_out(const Options& options, const db::Store& store, const db::LoadedScan& loaded, Context& context) {
  const std::vector<MethodChoice> choices = chosen_methods(options.method, store, store.scan(options.name).id);
  warn_if_seen_in_training(choices, options.every);
  const Protocol protocol = held_out(loaded.scan, options.every, evaluation_options(options));
  finish(options, context, judge(options, loaded.scan, protocol, choices));
}

void evaluate_subsample(const Options& options, const db::Store& store, const db::LoadedScan& loaded,
                        Context& context) {
  const std::vector<MethodChoice> choices = chosen_methods(options.method, store, store.scan(options.name).id);
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
  const std::vector<MethodChoice> choices = chosen_methods(options.method, store, scan.id);
  const model::EvaluationOptions evaluation = evaluation_options(options);
  Protocol protocol;
  if (options.off_grid || (!options.held_out && is_simulated(scan))) {
    const OffGrid queries(options, SimulatedTruth(store, options.name, {}), loaded);
    protocol = off_grid(loaded.scan, queries.directions, queries.truth, evaluation);
  } else {
    warn_if_seen_in_training(choices, options.every);
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
  const std::vector<MethodChoice> choices = chosen_methods(options.method, store, scan.id);
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

// An option that some protocols alone heed; to the others it would be of no use.
struct Belonging {
  const char* option;
  std::vector<std::string> protocols;
};

const std::vector<Belonging> kBelongings{
    {"--every", {"--held-out", "--frontier"}},
    {"--directions", {"--off-grid", "--subsample", "--frontier"}},
    {"--seed", {"--off-grid", "--subsample", "--frontier"}},
    {"--from", {"--arc"}},
    {"--to", {"--arc"}},
    {"--steps", {"--arc"}},
    {"--sheet", {"--off-grid"}},
    {"--report", {"--held-out", "--off-grid", "--subsample"}},
    {"--hdr-flip", {"--held-out", "--off-grid", "--subsample", "--frontier"}},
    {"--metric-model", {"--held-out", "--off-grid", "--subsample", "--frontier"}},
    {"--linear", {"--held-out", "--off-grid", "--subsample", "--frontier", "--arc"}},
    {"--method", {"--held-out", "--off-grid", "--subsample", "--frontier", "--arc"}},
};

// Of the options on the command line, which asks for one thing to be measured.
std::string protocol_of(const CLI::App& command) {
  const auto given = [&](const char* option) { return command.get_option(option)->count() > 0; };
  std::vector<std::string> asked;
  for (const char* protocol : {"--subsample", "--frontier", "--arc", "--accuracy"}) {
    if (given(protocol)) asked.emplace_back(protocol);
  }
  const bool both = given("--held-out") && given("--off-grid");
  if (!given("--frontier")) {  // which is measured by one of these two
    for (const char* protocol : {"--held-out", "--off-grid"}) {
      if (given(protocol)) asked.emplace_back(protocol);
    }
  }
  if (asked.size() != 1 || both) {
    throw core::UsageError("give one of --held-out, --off-grid, --subsample, --frontier, --arc and --accuracy");
  }
  return asked.front();
}

void refuse_useless(const CLI::App& command, const Options& options) {
  const std::string protocol = protocol_of(command);
  for (const auto& [option, protocols] : kBelongings) {
    if (command.get_option(option)->count() == 0) continue;
    if (std::find(protocols.begin(), protocols.end(), protocol) != protocols.end()) continue;
    throw core::UsageError(std::string(option) + " goes with " + core::joined(protocols, ", "));
  }
  if (!options.subsample.empty() && options.method.knobs.contains("--neighbours"))
    throw core::UsageError(
        "--subsample blends as many neighbours as published for each number of lights; leave out --neighbours");
}

void run_evaluate(const Options& options, Context& context) {
  const db::Store store = context.open_store();
  const db::LoadedScan loaded = load_scan(store, options.name);
  for (const std::filesystem::path& folder : {options.report, options.frontier, options.arc}) {
    if (!folder.empty()) core::make_folder(folder);
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
      ->check(seed_number());
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
  for (const char* file : {"--frontier", "--arc", "--sheet", "--report", "--metric-model"}) {
    command->get_option(file)->check([](const std::string& text) { return text.empty() ? "is empty" : std::string(); });
  }
  command->callback([command, options, &context] {
    refuse_useless(*command, *options);
    run_evaluate(*options, context);
  });
}

}  // namespace lightstage::cli
