#include <map>

#include <CLI/CLI.hpp>
#include <nlohmann/json.hpp>

#include "cli/commands.h"
#include "cli/format.h"
#include "cli/jobs/align.h"
#include "cli/jobs/register.h"
#include "cli/options.h"
#include "core/text.h"

namespace lightstage::cli {

namespace {

struct Options {
  std::string name;
  bool robust = false;
  AlignOptions job;
};

// Adds the frames that are left out to the text.
nlohmann::ordered_json list_excluded(const std::vector<ExcludedFrame>& frames, std::string& text) {
  nlohmann::ordered_json excluded = nlohmann::ordered_json::array();
  for (const ExcludedFrame& frame : frames) {
    text += "  camera '" + frame.camera + "', step " + std::to_string(frame.step_index) +
            (frame.light_index ? " (light " + std::to_string(*frame.light_index) + ")" : " (tracking)") +
            " is left out: " + frame.reason + "\n";
    excluded.push_back({{"camera", frame.camera},
                        {"step", frame.step_index},
                        {"light", or_null(frame.light_index)},
                        {"reason", frame.reason}});
  }
  return excluded;
}

void run_robust(const Options& options, Context& context) {
  db::Store store = context.open_store();
  store.require_writable();
  const RegisterReport report = register_scan(store, store.scan(options.name));
  std::string text =
      "registered " + core::counted(report.aligned, "frame") + " with those of the lights beside theirs\n  motion " +
      fixed(report.median_motion_px, 2) + " px median, " + fixed(report.largest_motion_px, 2) + " px at most; " +
      fixed(report.residual_before_px, 2) + " px from what the neighbours predict, now " +
      fixed(report.residual_after_px, 2) +
      " px\n  weaker than tracking frames: rigid motion in the picture only, and shadows that wander with "
      "the light may count as motion\n";
  const nlohmann::ordered_json excluded = list_excluded(report.excluded, text);
  context.result(text, {{"scan", options.name},
                        {"robust", true},
                        {"aligned", report.aligned},
                        {"median_motion_px", report.median_motion_px},
                        {"largest_motion_px", report.largest_motion_px},
                        {"residual_before_px", report.residual_before_px},
                        {"residual_after_px", report.residual_after_px},
                        {"excluded", excluded}});
}

void run_align(const Options& options, Context& context) {
  db::Store store = context.open_store();
  store.require_writable();
  const AlignReport report = align_scan(store, store.scan(options.name), options.job);
  std::string text = "aligned " + core::counted(report.aligned, "frame") + " to the key pose by " +
                     core::counted(report.tracking_frames, "tracking frame") + "\n  motion " +
                     fixed(report.median_motion_px, 2) + " px median, " + fixed(report.largest_motion_px, 2) +
                     " px at most; tracking frames differed by " + fixed(report.residual_before, 4) + ", now by " +
                     fixed(report.residual_after, 4) + "\n  " + fixed(100 * report.believed, 1) +
                     " % of the subject is found there and back; " + fixed(100 * report.masked, 2) +
                     " % is hidden in a frame, and masked\n";
  const nlohmann::ordered_json excluded = list_excluded(report.excluded, text);
  if (!report.lost_lights.empty()) {
    text += "  to have the " + std::to_string(report.lost_lights.size()) +
            " lights that this costs, run `lightstage capture --retake --name " + options.name + "` and align again\n";
  }
  context.result(text, {{"scan", options.name},
                        {"aligned", report.aligned},
                        {"tracking_frames", report.tracking_frames},
                        {"median_motion_px", report.median_motion_px},
                        {"largest_motion_px", report.largest_motion_px},
                        {"residual_before", report.residual_before},
                        {"residual_after", report.residual_after},
                        {"believed", report.believed},
                        {"masked", report.masked},
                        {"excluded", excluded},
                        {"lost_lights", report.lost_lights}});
}

}  // namespace

void add_align(CLI::App& program, Context& context) {
  CLI::App* command =
      program.add_subcommand("align", "Undo the subject's motion, by optical flow of the tracking frames");
  command->footer("Examples:\n  lightstage align head\n  lightstage align photographs --robust");
  auto options = std::make_shared<Options>();
  command->add_option("SCAN", options->name, "The scan")->required();
  std::map<std::string, align::FlowPreset> presets{{"fast", align::FlowPreset::kDisFast},
                                                   {"medium", align::FlowPreset::kDisMedium}};
  for (const auto& [name, preset] : align::kFlowPresets) presets.emplace(name, preset);
  command
      ->add_option("--flow", options->job.preset,
                   "dis-ultrafast, dis-fast (or fast), dis-medium (or medium), fine, farneback, tvl1 or deepflow: "
                   "docs/alignment.md has their times and errors [fine]")
      ->transform(one_of(presets));
  command->add_option("--shrink", options->job.shrink, "Compute flow on pictures so many times smaller")
      ->capture_default_str()
      ->check(CLI::Range(1, 16));
  const std::map<std::string, align::Between> ways{{"linear", align::Between::kLinear},
                                                   {"catmull-rom", align::Between::kCatmullRom}};
  command
      ->add_option("--between", options->job.between,
                   "How the subject moves between tracking frames: linear or catmull-rom [catmull-rom]")
      ->transform(one_of(ways));
  CLI::Option* robust = command->add_flag(
      "--robust", options->robust,
      "Without tracking frames: register the pictures under different lights with each other, rigidly (weaker)");
  for (const char* name : {"--flow", "--shrink", "--between"}) robust->excludes(command->get_option(name));
  command->callback(
      [options, &context] { options->robust ? run_robust(*options, context) : run_align(*options, context); });
}

}  // namespace lightstage::cli
