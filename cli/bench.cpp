#include <memory>
#include <optional>

#include <CLI/CLI.hpp>
#include <nlohmann/json.hpp>

#include "cli/commands.h"
#include "cli/format.h"
#include "model/engine_bench.h"

namespace lightstage::cli {

namespace {

struct Options {
  int size = 1024;
  std::string preset = "paper";
};

nlohmann::ordered_json or_null(const std::optional<double>& value) {
  return value ? nlohmann::ordered_json(*value) : nlohmann::ordered_json();
}

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

}  // namespace

void add_bench(CLI::App& program, Context& context) {
  CLI::App* command = program.add_subcommand("bench", "Measure the speed of this machine at the program's heavy work");
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
}

}  // namespace lightstage::cli
