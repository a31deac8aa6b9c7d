#include <algorithm>

#include <CLI/CLI.hpp>
#include <nlohmann/json.hpp>

#include "cli/commands.h"
#include "cli/format.h"
#include "cli/jobs/method_options.h"
#include "cli/jobs/scans.h"
#include "cli/jobs/truth.h"
#include "cli/report/contact_sheet.h"
#include "core/error.h"
#include "core/image_file.h"
#include "core/progress.h"
#include "core/text.h"
#include "model/checkpoint.h"
#include "model/evaluation.h"

namespace lightstage::cli {

namespace {

using nlohmann::ordered_json;

struct Options {
  std::string name;
  bool held_out = false, off_grid = false, accuracy = false;
  int every = 1;
  std::size_t directions = 60;
  std::uint64_t seed = 1;
  bool linear = false;
  std::filesystem::path sheet;
  MethodChoice method;
};

std::vector<std::string> split_names(const std::string& text) {
  std::vector<std::string> names;
  for (const std::string_view name : core::split(text, ',')) {
    if (!name.empty()) names.emplace_back(name);
  }
  return names;
}

// The methods asked for by name; without --method all that can run.
std::vector<MethodChoice> chosen_methods(const Options& options, const db::Store& store, db::Id scan_id) {
  std::vector<std::string> names = split_names(options.method.method);
  std::optional<model::Architecture> given;  // what --model is for
  if (!options.method.model.empty()) {
    given = model::read_checkpoint_info(find_model(store, options.method.model)).config.architecture;
  }
  if (names.empty()) {
    for (const model::MethodInfo& method : model::methods()) {
      const auto architecture = network_of(method.name);
      if (architecture != model::Architecture::kSuperres || architecture == given ||
          newest_model(store, scan_id, {.architecture = architecture})) {
        names.push_back(method.name);
      }
    }
  }
  if (given && std::find(names.begin(), names.end(), model::architecture_name(*given)) == names.end()) {
    throw core::UsageError(options.method.model + " is a model for --method " +
                           std::string(model::architecture_name(*given)) + ", which is not among the methods");
  }
  refuse_useless_knobs(options.method, names);
  std::vector<MethodChoice> choices;
  for (const std::string& name : names) {
    MethodChoice choice = for_method(options.method, name);
    if (network_of(name) != given) choice.model.clear();
    choices.push_back(resolve(choice, store, scan_id));
  }
  return choices;
}

std::vector<model::InterpolatorFactory> factories(const std::vector<MethodChoice>& choices) {
  std::vector<model::InterpolatorFactory> made;
  for (const MethodChoice& choice : choices) {
    made.push_back([&choice](const core::OlatScan& scan) {
      return model::make_interpolator(choice.method, scan, choice.options);
    });
  }
  return made;
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

ordered_json to_json(const std::vector<model::MethodScore>& scores) {
  ordered_json array = ordered_json::array();
  for (const model::MethodScore& score : scores) {
    array.push_back({{"name", score.name},
                     {"images", score.images},
                     {"rmse", score.rmse},
                     {"h1", score.h1},
                     {"dssim", score.dssim},
                     {"flip", score.flip},
                     {"seconds_per_image", score.seconds_per_image}});
  }
  return array;
}

std::string to_text(const std::vector<model::MethodScore>& scores) {
  std::vector<std::vector<std::string>> rows{{"method", "images", "RMSE", "H1", "DSSIM", "FLIP", "s/image"}};
  const model::MethodScore* best = nullptr;
  for (const model::MethodScore& score : scores) {
    rows.push_back({score.name, std::to_string(score.images), fixed(score.rmse, 4), fixed(score.h1, 4),
                    fixed(score.dssim, 4), fixed(score.flip, 4), fixed(score.seconds_per_image, 4)});
    if (best == nullptr || score.rmse < best->rmse) best = &score;
  }
  std::string text = table(rows);
  if (scores.size() > 1) text += "lowest RMSE: " + best->name + "\n";
  return text;
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

void report_scores(const Options& options, const Context& context, const char* protocol,
                   const std::vector<model::MethodScore>& scores) {
  context.result("'" + options.name + "', " + protocol + ", " + (options.linear ? "linear" : "display-encoded") +
                     " values over the mask\n" + to_text(scores),
                 {{"scan", options.name}, {"protocol", protocol}, {"methods", to_json(scores)}});
}

void evaluate_off_grid(const Options& options, const db::Store& store, const db::LoadedScan& loaded, Context& context) {
  const std::vector<MethodChoice> choices = chosen_methods(options, store, store.scan(options.name).id);
  const std::vector<core::Direction> directions =
      model::off_grid_directions(loaded.scan.directions(), options.directions, options.seed);
  const SimulatedTruth simulated(store, options.name, {});
  core::note("rendering the truth for " + std::to_string(directions.size()) + " directions");
  const std::vector<core::Image> truth = simulated.render(directions);
  const auto scores =
      model::evaluate_against_truth(loaded.scan, factories(choices), directions,
                                    [&](std::size_t i) { return truth[i]; }, {.linear_values = options.linear});
  if (!options.sheet.empty()) write_sheet(options.sheet, loaded.scan, choices, directions, truth, options.linear);
  report_scores(options, context, "off-grid", scores);
}

void evaluate_held_out(const Options& options, const db::Store& store, const db::LoadedScan& loaded, Context& context) {
  if (!options.sheet.empty()) throw core::UsageError("--sheet goes with --off-grid");
  const std::vector<MethodChoice> choices = chosen_methods(options, store, store.scan(options.name).id);
  warn_if_seen_in_training(options, choices);
  report_scores(
      options, context, "held-out",
      model::evaluate_held_out(loaded.scan, factories(choices), options.every, {.linear_values = options.linear}));
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

void run_evaluate(const Options& options, Context& context) {
  if (int(options.held_out) + int(options.off_grid) + int(options.accuracy) != 1) {
    throw core::UsageError("give one of --held-out, --off-grid and --accuracy");
  }
  const db::Store store = context.open_store();
  const db::LoadedScan loaded = load_scan(store, options.name);
  if (options.off_grid) {
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
      "  lightstage evaluate head --accuracy       (calibration and alignment; simulated scans)");
  auto options = std::make_shared<Options>();
  command->add_option("SCAN", options->name, "The scan")->required();
  command->add_flag("--held-out", options->held_out, "Leave each light out in turn and predict it from the others");
  command->add_flag("--off-grid", options->off_grid,
                    "Predict directions where no light stands, against the simulator's truth (simulated scans)");
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
  add_method_options(*command, options->method, "Methods, separated by commas [all; superres if the scan has a model]");
  command->callback([options, &context] { run_evaluate(*options, context); });
}

}  // namespace lightstage::cli
