#include "cli/bench/store_command.h"

#include <memory>

#include <CLI/CLI.hpp>
#include <nlohmann/json.hpp>

#include "cli/bench/store_bench.h"
#include "cli/format.h"
#include "cli/options.h"
#include "core/unfinished_folder.h"
#include "db/rows_bench.h"

namespace lightstage::cli {

namespace {

using nlohmann::ordered_json;

struct Options {
  StoreBenchOptions load{.folder = "."};
  std::size_t rows = 1'000'000;
};

std::string megabytes(double bytes_per_s) {
  return fixed(bytes_per_s * 1e-6, 0) + " MB/s";
}

void run_bench_store(const Options& options, Context& context) {
  const StoreBench load = bench_store(options.load);
  db::RowsBench rows;
  {
    const core::UnfinishedFolder scratch(options.load.folder / "lightstage-bench");
    rows = db::bench_rows({.folder = scratch.path() / "store", .rows = options.rows});
  }
  const StoreStageOptions& stage = options.load.stage;
  const auto peak_rss = load.peak_rss_bytes;
  const std::string text =
      table({{std::to_string(load.frames) + " frames, " + std::to_string(stage.cameras) + " cameras", "", ""},
             {"stored", megabytes(load.ingest_bytes_per_s),
              fixed(load.frames_per_s, 0) + " frames/s (" + fixed(stage.frames_per_s * stage.cameras, 0) + " asked), " +
                  fixed(load.steps_per_s, 1) + " lights/s"},
             {"one file, one fsync", megabytes(load.plain_write_bytes_per_s),
              fixed(100 * load.ratio(), 0) + " % of it reached"},
             {"a file and an fsync a frame", megabytes(load.fsync_each_bytes_per_s), ""},
             {"verified", megabytes(load.verify_bytes_per_s), ""},
             {"read plainly", megabytes(load.plain_read_bytes_per_s), ""}}) +
      "\n" + std::to_string(load.dropped) + " dropped, " + std::to_string(load.retaken) + " retaken, " +
      std::to_string(load.wrong) + " of " + std::to_string(load.looked_at) + " looked at wrong; resident " +
      fixed(double(load.early_rss_bytes) * 1e-6, 0) + " MB early, " + fixed(double(load.late_rss_bytes) * 1e-6, 0) +
      " MB late" + (peak_rss ? ", " + fixed(double(*peak_rss) * 1e-6, 0) + " MB at most" : "") + "\n" +
      std::to_string(rows.rows) + " frame rows: opened in " + fixed(rows.start_ms, 0) + " ms, listed in " +
      fixed(rows.list_ms, 0) + " ms, one scan verified in " + fixed(rows.verify_one_scan_ms, 0) + " ms\n";

  ordered_json rounds = ordered_json::array();
  for (const StoreBench::Round& round : load.rounds) {
    rounds.push_back(
        {{"ingest_bytes_per_s", round.ingest_bytes_per_s}, {"plain_write_bytes_per_s", round.plain_write_bytes_per_s}});
  }
  context.result(text, {{"ingest_bytes_per_s", load.ingest_bytes_per_s},
                        {"plain_write_bytes_per_s", load.plain_write_bytes_per_s},
                        {"ratio", load.ratio()},
                        {"fsync_each_bytes_per_s", load.fsync_each_bytes_per_s},
                        {"frames", load.frames},
                        {"dropped", load.dropped},
                        {"retaken", load.retaken},
                        {"wrong", load.wrong},
                        {"looked_at", load.looked_at},
                        {"cameras", stage.cameras},
                        {"width", stage.width},
                        {"height", stage.height},
                        {"frames_per_s_asked", stage.frames_per_s * stage.cameras},
                        {"frames_per_s", load.frames_per_s},
                        {"steps_per_s", load.steps_per_s},
                        {"bytes_per_frame", load.bytes_per_frame},
                        {"peak_rss_bytes", or_null(peak_rss)},
                        {"early_rss_bytes", load.early_rss_bytes},
                        {"late_rss_bytes", load.late_rss_bytes},
                        {"verify_bytes_per_s", load.verify_bytes_per_s},
                        {"plain_read_bytes_per_s", load.plain_read_bytes_per_s},
                        {"rows", rows.rows},
                        {"catalogue_bytes", rows.catalogue_bytes},
                        {"start_ms_at_1m_rows", rows.start_ms},
                        {"list_ms_at_1m_rows", rows.list_ms},
                        {"verify_one_scan_ms_at_1m_rows", rows.verify_one_scan_ms},
                        {"rounds", rounds}});
}

}  // namespace

void add_bench_store(CLI::App& bench, Context& context) {
  const auto options = std::make_shared<Options>();
  CLI::App* command = bench.add_subcommand(
      "store",
      "What the store takes in from cameras that do not wait, against plain writing on the same disk; how fast it is "
      "checked; and how quick it is with a million frames");
  command->fallthrough();
  StoreBenchOptions& load = options->load;
  command->add_option("--folder", load.folder, "On the disk to measure; the bench removes what it makes there")
      ->capture_default_str()
      ->check(CLI::ExistingDirectory);
  command->add_option("--frames", load.frames, "Frames to take in, in rounds whose frames are removed again")
      ->capture_default_str()
      ->check(CLI::Range(1, 10'000'000));
  command->add_option("--rows", options->rows, "Frames of the large catalogue")
      ->capture_default_str()
      ->check(CLI::Range(1, 100'000'000));
  command->add_option("--cameras", load.stage.cameras, "Cameras")->capture_default_str()->check(CLI::Range(1, 12));
  command->add_option("--width", load.stage.width, "Of the pictures, pixels")
      ->capture_default_str()
      ->check(CLI::Range(16, 16384));
  command->add_option("--height", load.stage.height, "Of the pictures, pixels")
      ->capture_default_str()
      ->check(CLI::Range(16, 16384));
  command->add_option("--fps", load.stage.frames_per_s, "Pictures a second that each camera can take")
      ->capture_default_str()
      ->check(number_between(0.1, 10000.0));
  command->add_option("--lights", load.stage.lights, "Lights of a round")
      ->capture_default_str()
      ->check(CLI::Range(1, 10000));
  command->footer("Example:\n  lightstage bench store --folder /data --json");
  command->callback([options, &context] {
    if (options->load.stage.lights > std::size_t(options->load.stage.height)) {
      throw core::UsageError("--lights: at most as many as the pictures have rows (" +
                             std::to_string(options->load.stage.height) + "), so that no two are alike");
    }
    run_bench_store(*options, context);
  });
}

}  // namespace lightstage::cli
