#include <algorithm>
#include <limits>
#include <map>

#include <CLI/CLI.hpp>
#include <nlohmann/json.hpp>

#include "cli/commands.h"
#include "cli/format.h"
#include "cli/jobs/scans.h"
#include "cli/jobs/simulated_views.h"
#include "cli/jobs/train.h"
#include "cli/options.h"
#include "cli/seed_option.h"
#include "core/error.h"
#include "core/text.h"
#include "model/training.h"

namespace lightstage::cli {

namespace {

struct Options {
  std::vector<std::string> scans;
  std::string preset = "tiny";
  std::string start_from;
  std::optional<int> neighbours;
  std::string channels;
  model::Pooling pooling = model::Pooling::kAliasFree;
  bool freeze_sharpness = false;
  std::filesystem::path out;
  int hold_out_every = 0;
  std::optional<std::size_t> simulated;
  std::filesystem::path meshes;
  model::TrainOptions train;
};

void show(const model::TrainReport& report, const Options& options, Context& context) {
  std::string text = "trained " + std::to_string(report.parameters) + " parameters for " +
                     std::to_string(report.steps) + " steps in " + fixed(report.seconds, 0) + " s; validation error " +
                     fixed(report.best_validation, 4) + ", rbf " + fixed(report.guide_validation, 4) + "\nwrote " +
                     options.out.string() + " (the best weights) and " +
                     model::last_checkpoint_path(options.out).string() + " (the last)\n";
  if (report.stopped_early) text += "stopped early: validation no longer improved\n";
  if (report.stopped_by_nan) text += "stopped early: the loss was not finite; the file holds the last good weights\n";
  context.result(text, {{"model", options.out.string()},
                        {"steps", report.steps},
                        {"seconds", report.seconds},
                        {"parameters", report.parameters},
                        {"validation", report.best_validation},
                        {"rbf_validation", report.guide_validation},
                        {"last", model::last_checkpoint_path(options.out).string()},
                        {"stopped_early", report.stopped_early},
                        {"stopped_by_nan", report.stopped_by_nan}});
}

model::TrainReport train_on_simulated(const Options& options) {
  SimulatedViewsOptions views{.views = *options.simulated, .meshes = {}, .seed = options.train.seed};
  if (!options.meshes.empty()) {
    for (const auto& entry : std::filesystem::directory_iterator(options.meshes)) {
      if (entry.is_regular_file()) views.meshes.push_back(entry.path());
    }
    std::sort(views.meshes.begin(), views.meshes.end());
    if (views.meshes.empty()) throw core::BadInput(options.meshes.string() + ": holds no meshes");
  }
  return model::train(simulated_views(views), options.train, options.out);
}

std::filesystem::path model_file(const std::string& file_or_name, const Context& context) {
  if (const auto file = file_or_shipped_model(file_or_name)) return *file;
  return find_model(context.open_store(), file_or_name);
}

// "16,32,64"; CLI11 would pass over a number that is missing between commas.
std::vector<int> whole_numbers(const std::string& option, const std::string& text) {
  std::vector<int> numbers;
  for (const std::string_view piece : core::split(text, ',')) {
    const auto number = core::parse_integer(core::trim(piece));
    if (!number || *number < 0 || *number > std::numeric_limits<int>::max()) {
      throw core::UsageError(option + ": '" + text + "' is not a list of whole numbers, separated by commas");
    }
    numbers.push_back(int(*number));
  }
  return numbers;
}

// The preset with the sizes that were asked for.
model::NetworkConfig network_of(const Options& options) {
  model::NetworkConfig config = model::network_preset(options.preset);
  if (options.neighbours) config.neighbours = *options.neighbours;
  if (!options.channels.empty()) config.channels = whole_numbers("--channels", options.channels);
  if (options.pooling == model::Pooling::kAverage && config.architecture != model::Architecture::kSuperres) {
    throw core::UsageError("--pooling average: " + options.preset + " pools alias_free only");
  }
  config.pooling = options.pooling;
  try {
    model::network_tensors(config);
  } catch (const core::BadInput& error) {
    throw core::UsageError(error.what());
  }
  return config;
}

void run_train(Options options, Context& context) {
  if (!options.start_from.empty()) {
    options.train.start_from = model_file(options.start_from, context);
    options.train.config = model::read_checkpoint_info(*options.train.start_from).config;
  } else {
    options.train.config = network_of(options);
    if (options.preset == "tiny") {
      // For minutes: coarse pictures would take most of them (docs/model.md).
      options.train.progressive = options.train.progressive.value_or(false);
      options.train.learning_rate = options.train.learning_rate.value_or(4e-3);
    }
  }
  // m = 16 for k = 8, as published.
  options.train.candidates = std::max(options.train.candidates, 2 * options.train.config.neighbours);
  if (options.freeze_sharpness) options.train.sharpness_rate = 0;
  if (!options.train.minutes && !options.train.steps) options.train.minutes = 10;
  if (options.simulated) {
    show(train_on_simulated(options), options, context);
    return;
  }
  if (options.scans.empty()) throw core::UsageError("give the scans to learn from, or --simulated");
  db::Store store = context.open_store();
  options.train.held_out_every = options.hold_out_every;
  const model::TrainReport report = train_on_scans(store, options.scans, options.train, options.out);
  show(report, options, context);
}

}  // namespace

void add_train(CLI::App& program, Context& context) {
  CLI::App* command = program.add_subcommand("train", "Train the super-resolution network on one scan or several");
  command->footer(
      "Examples:\n"
      "  lightstage train head --start-from blend --minutes 2 --out head.safetensors\n"
      "  lightstage train bear --preset blend --hold-out-every 4 --minutes 5 --out bear.safetensors\n"
      "  lightstage evaluate bear --held-out --every 4 --method blend,rbf,linear --model bear.safetensors");
  auto options = std::make_shared<Options>();
  CLI::Option* scans = command->add_option("SCAN", options->scans, "Scans to learn from");
  command
      ->add_option("--out", options->out,
                   "The model file to write (.safetensors); it must not exist, unless it is the one to resume")
      ->required();
  CLI::Option* preset =
      command
          ->add_option(
              "--preset", options->preset,
              "Network: tiny, small or paper (superres, from small to as published), blend, xu, xu_adaptive or meka")
          ->capture_default_str();
  CLI::Option* neighbours = command
                                ->add_option("--neighbours", options->neighbours,
                                             "Lights a picture is made from, instead of the preset's number (8)")
                                ->check(CLI::Range(1, 64));
  CLI::Option* channels =
      command->add_option("--channels", options->channels,
                          "Channels of each level, from fine to coarse, instead of the preset's: 16,32,64");
  const std::map<std::string, model::ActiveSetChoice> active_sets{{"random", model::ActiveSetChoice::kRandom},
                                                                  {"naive", model::ActiveSetChoice::kNaive},
                                                                  {"thinned", model::ActiveSetChoice::kThinned}};
  CLI::Option* active_set =
      command
          ->add_option(
              "--active-set", options->train.active_set,
              "Neighbours of a captured light in training: random ones of the nearest 16 [superres]; naive, the "
              "nearest; or thinned, the nearest of a stage with fewer lights, among which it stands as queries "
              "do [blend]")
          ->transform(one_of(active_sets));
  const std::map<std::string, model::Pooling> poolings{{"alias_free", model::Pooling::kAliasFree},
                                                       {"average", model::Pooling::kAverage}};
  CLI::Option* pooling =
      command
          ->add_option("--pooling", options->pooling, "Of superres: alias_free, or average, which jumps [alias_free]")
          ->transform(one_of(poolings));
  const std::map<std::string, bool> on_off{{"on", true}, {"off", false}};
  command
      ->add_option("--progressive", options->train.progressive,
                   "on or off: train coarse pictures first [on for small and paper; others than superres cannot]")
      ->transform(one_of(on_off));
  command->add_option("--minutes", options->train.minutes, "Time to train [10]")->check(number_between(0.01, 1e5));
  command->add_option("--steps", options->train.steps, "At most so many steps, instead of --minutes or besides them")
      ->check(CLI::Range(std::int64_t(1), std::int64_t(1) << 40));
  command->add_option("--crop", options->train.crop, "Side of the training crops, pixels")
      ->capture_default_str()
      ->check(CLI::Range(16, 4096));
  command
      ->add_option("--learning-rate", options->train.learning_rate,
                   "Of Adam, at the start [0.001, for tiny 0.004, for blend 0.002; a tenth with --start-from]")
      ->check(number_between(1e-8, 1.0));
  CLI::Option* sharpness_rate =
      command
          ->add_option("--sharpness-rate", options->train.sharpness_rate,
                       "Learning rate of the weights' sharpness s, as a factor of the rate of all else")
          ->capture_default_str()
          ->check(number_between(0, 100));
  command->add_flag("--freeze-sharpness", options->freeze_sharpness, "Leave the sharpness s as it is")
      ->excludes(sharpness_rate);
  command->add_option("--validate-every", options->train.validate_every, "Steps between validations")
      ->capture_default_str()
      ->check(CLI::Range(1, 1 << 30));
  command
      ->add_option("--early-stop", options->train.early_stop,
                   "Stop after so many validations without a new best one; progressive training counts at full size")
      ->check(CLI::Range(1, 1 << 30));
  command->add_option("--seed", options->train.seed, "Seed of weights and draws")
      ->capture_default_str()
      ->check(seed_number());
  CLI::Option* hold_out =
      command
          ->add_option("--hold-out-every", options->hold_out_every,
                       "Never show the network lights 0, n, 2n, ..., so that `evaluate --held-out --every n` is fair")
          ->check(CLI::Range(2, 1000));
  CLI::Option* simulated =
      command
          ->add_option("--simulated", options->simulated,
                       "Learn from so many simulated views, with the truth between the lights, instead of scans")
          ->check(CLI::Range(5, 100000))
          ->excludes(scans)
          ->excludes(active_set)
          ->excludes(hold_out);
  command->add_option("--meshes", options->meshes, "Folder of head meshes for every second simulated view")
      ->needs(simulated)
      ->check(CLI::ExistingDirectory);
  command
      ->add_option("--start-from", options->start_from,
                   "Train this model (a file, a name, or blend, the shipped one) further on other data")
      ->excludes(preset)
      ->excludes(pooling)
      ->excludes(neighbours)
      ->excludes(channels);
  command->add_option("--resume", options->train.resume,
                      "Go on with the run that wrote this file (its --out), with the same options");
  command->callback([options, &context] { run_train(*options, context); });
}

}  // namespace lightstage::cli
