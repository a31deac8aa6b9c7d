#include <cmath>
#include <memory>
#include <optional>

#include <CLI/CLI.hpp>
#include <nlohmann/json.hpp>

#include "cli/bench/align_command.h"
#include "cli/bench/calib_command.h"
#include "cli/bench/relight_command.h"
#include "cli/bench/store_command.h"
#include "cli/commands.h"
#include "cli/format.h"
#include "cli/options.h"
#include "model/engine_bench.h"
#include "sim/timing_bench.h"

namespace lightstage::cli {

namespace {

struct Options {
  int size = 1024;
  std::string preset = "paper";
};

struct CaptureOptions {
  int lights = 100;
  int cameras = 2;
  double exposure_ms = 8, settle_ms = 2, command_ms = 1, transfer_ms = 20, jitter_ms = 2, camera_fps = 60;
  double loss_percent = 0;
  bool untriggered = false;
};

void run_bench_model(const Options& options, Context& context) {
  const model::EngineBench bench = model::bench_engine(model::network_preset(options.preset), options.size);
  const double ratio = bench.straightforward_s / bench.engine_s;
  const double gflops = bench.gflop_per_query / bench.engine_s;
  const double roofline_ratio = gflops / bench.roofline_gflops;

  std::vector<std::vector<std::string>> rows{
      {"one query, " + options.preset + ", " + std::to_string(options.size) + " pixels", "seconds", "times faster"},
      {"plain libtorch", fixed(bench.straightforward_s, 4), "1.0"},
      {"engine", fixed(bench.engine_s, 4), fixed(ratio, 1)}};
  if (bench.engine_bf16_s) {
    rows.push_back(
        {"engine, bf16", fixed(*bench.engine_bf16_s, 4), fixed(bench.straightforward_s / *bench.engine_bf16_s, 1)});
  }
  std::string text = table(rows);
  text += "\nencoding one captured image: " + fixed(bench.encode_s, 4) + " s\n" + fixed(bench.gflop_per_query, 2) +
          " GFLOP a query: " + fixed(gflops, 1) + " GFLOP/s, " + fixed(100 * roofline_ratio, 0) + " % of " +
          fixed(bench.roofline_gflops, 1) + " (the fastest conv2d of the network's shapes)\n" +
          fixed(bench.bytes_moved * 1e-6, 0) + " MB moved a query, " + fixed(double(bench.peak_rss_bytes) * 1e-6, 0) +
          " MB resident at most\nlargest difference to plain libtorch: " + fixed(bench.max_abs_diff, 7);
  if (bench.max_abs_diff_bf16) text += ", bf16 " + fixed(*bench.max_abs_diff_bf16, 5);
  text += "\ntraining on crops of " + std::to_string(bench.train_size) + ": " + fixed(bench.train_steps_per_s, 3) +
          " steps a second, plain libtorch " + fixed(bench.straightforward_train_steps_per_s, 3) + "\n";

  context.result(text, {{"size", options.size},
                        {"preset", options.preset},
                        {"gflop_per_query", bench.gflop_per_query},
                        {"bytes_moved", bench.bytes_moved},
                        {"straightforward_s", bench.straightforward_s},
                        {"engine_s", bench.engine_s},
                        {"engine_bf16_s", or_null(bench.engine_bf16_s)},
                        {"encode_s", bench.encode_s},
                        {"ratio", ratio},
                        {"gflops", gflops},
                        {"roofline_gflops", bench.roofline_gflops},
                        {"roofline_ratio", roofline_ratio},
                        {"peak_rss_bytes", bench.peak_rss_bytes},
                        {"max_abs_diff", bench.max_abs_diff},
                        {"max_abs_diff_bf16", or_null(bench.max_abs_diff_bf16)},
                        {"train_size", bench.train_size},
                        {"train_steps_per_s", bench.train_steps_per_s},
                        {"straightforward_train_steps_per_s", bench.straightforward_train_steps_per_s}});
}

core::Nanoseconds nanoseconds(double milliseconds) {
  return core::from_units(milliseconds, core::kMillisecond);
}

void run_bench_capture(const CaptureOptions& options, Context& context) {
  sim::TimingBenchOptions bench;
  bench.lights = options.lights;
  bench.cameras = options.cameras;
  bench.exposure = nanoseconds(options.exposure_ms);
  bench.settle = nanoseconds(options.settle_ms);
  bench.times = {.command = nanoseconds(options.command_ms),
                 .transfer = nanoseconds(options.transfer_ms),
                 .transfer_jitter = nanoseconds(options.jitter_ms),
                 .shortest_period = nanoseconds(1000 / options.camera_fps),
                 .stamped_on_arrival = !options.untriggered,
                 .triggered = !options.untriggered};
  bench.drop_probability = options.loss_percent / 100;
  const std::vector<sim::TimingRow> rows = sim::bench_timing(bench);

  std::vector<std::vector<std::string>> cells{
      {"timing", "steps/s", "to lockstep", "preparation s", "pass s", "retaken", "wrong", "lights left on"}};
  nlohmann::ordered_json modes = nlohmann::ordered_json::array();
  for (const sim::TimingRow& row : rows) {
    const double preparation_s = double(row.report.preparation) / core::kSecond;
    const double duration_s = double(row.report.duration) / core::kSecond;
    const double ratio = row.steps_per_s / rows.front().steps_per_s;
    cells.push_back({std::string(to_string(row.timing)), fixed(row.steps_per_s, 1), fixed(ratio, 2),
                     fixed(preparation_s, 2), fixed(duration_s, 2), std::to_string(row.report.retaken),
                     std::to_string(row.wrong), row.lights_left ? "yes" : "no"});
    modes.push_back(
        {{"timing", to_string(row.timing)},
         {"steps_per_s", row.steps_per_s},
         {"ratio_to_lockstep", ratio},
         {"preparation_s", preparation_s},
         {"pass_s", duration_s},
         {"steps", row.report.steps},
         {"frames", row.report.stored},
         {"retaken", row.report.retaken},
         {"dropped", row.report.dropped},
         {"discarded", row.report.discarded},
         {"wrong", row.wrong},
         {"lights_left_on", row.lights_left},
         {"problem", row.problem.empty() ? nlohmann::ordered_json() : nlohmann::ordered_json(row.problem)}});
  }
  std::string problems;
  for (const sim::TimingRow& row : rows) {
    if (!row.problem.empty()) problems += std::string(to_string(row.timing)) + ": " + row.problem + "\n";
  }
  context.result(table(cells) + problems, {{"lights", options.lights},
                                           {"cameras", options.cameras},
                                           {"exposure_ms", options.exposure_ms},
                                           {"settle_ms", options.settle_ms},
                                           {"command_ms", options.command_ms},
                                           {"transfer_ms", options.transfer_ms},
                                           {"transfer_jitter_ms", options.jitter_ms},
                                           {"camera_fps", options.camera_fps},
                                           {"loss_percent", options.loss_percent},
                                           {"untriggered", options.untriggered},
                                           {"modes", modes}});
}

void add_bench_capture(CLI::App& bench, Context& context) {
  const auto options = std::make_shared<CaptureOptions>();
  CLI::App* command = bench.add_subcommand(
      "capture", "The timing modes of capture on simulated devices: steps a second, frames taken again, wrong ones");
  command->fallthrough();
  const auto milliseconds = [&](const char* name, double& value, const char* help) {
    command->add_option(name, value, help)->capture_default_str()->check(number_between(0.0, 10000.0));
  };
  command->add_option("--lights", options->lights, "Lights of the stage")
      ->capture_default_str()
      ->check(CLI::Range(8, 4096));
  command->add_option("--cameras", options->cameras, "Cameras")->capture_default_str()->check(CLI::Range(1, 12));
  command->add_option("--exposure", options->exposure_ms, "Exposure of the single lights, milliseconds")
      ->capture_default_str()
      ->check(number_between(0.1, 10000.0));
  milliseconds("--settle", options->settle_ms, "From switching lights to the exposure, milliseconds");
  milliseconds("--command", options->command_ms, "A controller's answer takes so long, milliseconds");
  milliseconds("--transfer", options->transfer_ms, "From the end of an exposure to its frame, milliseconds");
  milliseconds("--jitter", options->jitter_ms, "Up to so much longer, milliseconds");
  command->add_option("--fps", options->camera_fps, "Pictures a second that a camera can take")
      ->capture_default_str()
      ->check(number_between(0.1, 10000.0));
  command->add_option("--loss", options->loss_percent, "Frames that never arrive, percent")
      ->capture_default_str()
      ->check(number_between(0.0, 20.0));
  command->add_flag(
      "--untriggered", options->untriggered,
      "Cameras without a trigger input, which stamp the start of their exposures: lockstep against free_run");
  command->footer("Example:\n  lightstage bench capture --loss 1 --json");
  command->callback([options, &context] { run_bench_capture(*options, context); });
}

}  // namespace

void add_bench(CLI::App& program, Context& context) {
  CLI::App* command = program.add_subcommand("bench",
                                             "Measure the network's engine on this machine (model), relighting by plan "
                                             "(relight), calibration (calib), alignment (align), the timing modes "
                                             "of capture (capture), or the store under load (store)");
  command->require_subcommand(1);
  command->footer("Example:\n  lightstage bench model --size 512");
  const auto options = std::make_shared<Options>();
  CLI::App* network = command->add_subcommand(
      "model", "The published network's engine against plain libtorch: time, precision, memory, training");
  network->fallthrough();
  network
      ->add_option("--size", options->size,
                   "Pixels a side of the square picture: a multiple of 2^levels (tiny 16, small 32, paper 128)")
      ->capture_default_str()
      ->check(CLI::Range(1, 2048));
  network->add_option("--preset", options->preset, "tiny, small, or paper (the network as published)")
      ->capture_default_str();
  network->footer("Example:\n  lightstage bench model --size 1024 --json");
  network->callback([options, &context] { run_bench_model(*options, context); });
  add_bench_capture(*command, context);
  add_bench_align(*command, context);
  add_bench_calib(*command, context);
  add_bench_relight(*command, context);
  add_bench_store(*command, context);
}

}  // namespace lightstage::cli
