#include <algorithm>

#include <CLI/CLI.hpp>
#include <nlohmann/json.hpp>

#include "cli/commands.h"
#include "cli/format.h"
#include "cli/jobs/scans.h"
#include "cli/options.h"
#include "core/error.h"
#include "core/progress.h"
#include "db/content_hash.h"
#include "model/training.h"

namespace lightstage::cli {

namespace {

struct Options {
  std::vector<std::string> scans;
  std::string preset = "tiny";
  std::filesystem::path out;
  int hold_out_every = 0;
  model::TrainOptions train;
};

// All lights but every n-th, which a later `evaluate --held-out --every n` asks for.
core::OlatScan without_held_out(const core::OlatScan& scan, int every) {
  if (every == 0) return scan;
  std::vector<std::size_t> kept;
  for (std::size_t i = 0; i < scan.light_count(); ++i) {
    if (i % std::size_t(every) != 0) kept.push_back(i);
  }
  return scan.with_lights(kept);
}

void run_train(Options options, Context& context) {
  db::Store store = context.open_store();
  options.train.config = model::network_preset(options.preset);
  if (!options.train.minutes && !options.train.steps) options.train.minutes = 10;

  std::vector<core::OlatScan> scans;
  db::NewProduct product;
  product.kind = "weights";
  for (const std::string& name : options.scans) {
    const db::LoadedScan loaded = load_scan(store, name);
    scans.push_back(without_held_out(loaded.scan, options.hold_out_every));
    product.input_scans.push_back(store.scan(name).id);
    for (const auto& input : {loaded.calibration_id, loaded.alignment_id}) {
      if (input) product.input_products.push_back(*input);
    }
  }
  options.train.held_out_every = options.hold_out_every;
  const model::TrainReport report = model::train(scans, options.train, options.out);

  const std::filesystem::path file = std::filesystem::canonical(options.out);
  // The file holds the best weights; before the first validation those are linear blending's.
  double validation = report.linear_validation;
  for (const model::LossPoint& point : report.curve) validation = std::min(validation, point.validation);
  if (report.steps == 0) core::warn("the time was up before the first step: the model is as good as linear blending");
  product.parameters = json_text({{"file", file.string()},
                                  {"hash", db::hash_file(file).hex()},
                                  {"preset", options.preset},
                                  {"steps", report.steps},
                                  {"held_out_every", options.hold_out_every}});
  store.add_product(product);
  std::string text = "trained " + std::to_string(report.parameters) + " parameters for " +
                     std::to_string(report.steps) + " steps in " + fixed(report.seconds, 0) + " s; validation error " +
                     fixed(validation, 4) + ", linear blending " + fixed(report.linear_validation, 4) + "\nwrote " +
                     options.out.string() + "\n";
  if (report.stopped_by_nan) text += "stopped early: the loss was not finite; the file holds the last good weights\n";
  context.result(text, {{"model", options.out.string()},
                        {"steps", report.steps},
                        {"seconds", report.seconds},
                        {"parameters", report.parameters},
                        {"validation", validation},
                        {"linear_validation", report.linear_validation},
                        {"stopped_by_nan", report.stopped_by_nan}});
}

}  // namespace

void add_train(CLI::App& program, Context& context) {
  CLI::App* command = program.add_subcommand("train", "Train the super-resolution network on one scan or several");
  command->footer(
      "Examples:\n"
      "  lightstage train head --preset tiny --minutes 2 --out head.safetensors\n"
      "  lightstage train bear --hold-out-every 4 --minutes 5 --out bear.safetensors\n"
      "  lightstage evaluate bear --held-out --every 4 --method superres,rbf,linear --model bear.safetensors");
  auto options = std::make_shared<Options>();
  command->add_option("SCAN", options->scans, "Scans to learn from")->required();
  command->add_option("--out", options->out, "The model file to write (.safetensors)")->required();
  command->add_option("--preset", options->preset, "Size of the network: tiny or small")->capture_default_str();
  command->add_option("--minutes", options->train.minutes, "Time to train [10]")->check(number_between(0.01, 1e5));
  command->add_option("--steps", options->train.steps, "Train for so many steps instead")
      ->check(CLI::Range(std::int64_t(1), std::int64_t(1) << 40));
  command->add_option("--crop", options->train.crop, "Side of the training crops, pixels")
      ->capture_default_str()
      ->check(CLI::Range(16, 4096));
  command->add_option("--learning-rate", options->train.learning_rate, "Of Adam, at the start")
      ->capture_default_str()
      ->check(number_between(1e-8, 1.0));
  command->add_option("--seed", options->train.seed, "Seed of weights and draws")->capture_default_str();
  command
      ->add_option("--hold-out-every", options->hold_out_every,
                   "Never show the network lights 0, n, 2n, ..., so that `evaluate --held-out --every n` is fair")
      ->check(CLI::Range(2, 1000));
  command->add_option("--resume", options->train.resume, "Go on from this checkpoint");
  command->callback([options, &context] { run_train(*options, context); });
}

}  // namespace lightstage::cli
