#include <map>

#include <CLI/CLI.hpp>
#include <nlohmann/json.hpp>

#include "cli/commands.h"
#include "cli/format.h"
#include "cli/jobs/align.h"
#include "cli/options.h"

namespace lightstage::cli {

namespace {

struct Options {
  std::string name;
  AlignOptions job;
};

void run_align(const Options& options, Context& context) {
  db::Store store = context.open_store();
  const AlignReport report = align_scan(store, store.scan(options.name), options.job);
  context.result("aligned " + std::to_string(report.aligned) + " frames to the key pose by " +
                     std::to_string(report.tracking_frames) + " tracking frames\n  motion " +
                     fixed(report.median_motion_px, 2) + " px median, " + fixed(report.largest_motion_px, 2) +
                     " px at most; tracking frames differed by " + fixed(report.residual_before, 4) + ", now by " +
                     fixed(report.residual_after, 4) + "\n",
                 {{"scan", options.name},
                  {"aligned", report.aligned},
                  {"tracking_frames", report.tracking_frames},
                  {"median_motion_px", report.median_motion_px},
                  {"largest_motion_px", report.largest_motion_px},
                  {"residual_before", report.residual_before},
                  {"residual_after", report.residual_after}});
}

}  // namespace

void add_align(CLI::App& program, Context& context) {
  CLI::App* command =
      program.add_subcommand("align", "Undo the subject's motion, by optical flow of the tracking frames");
  command->footer("Example:\n  lightstage align head");
  auto options = std::make_shared<Options>();
  command->add_option("SCAN", options->name, "The scan")->required();
  const std::map<std::string, align::FlowPreset> presets{
      {"fast", align::FlowPreset::kFast}, {"medium", align::FlowPreset::kMedium}, {"fine", align::FlowPreset::kFine}};
  command->add_option("--flow", options->job.preset, "fast, medium or fine [fine]")->transform(one_of(presets));
  command->callback([options, &context] { run_align(*options, context); });
}

}  // namespace lightstage::cli
