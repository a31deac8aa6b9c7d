#include "cli/bench/align_command.h"

#include <memory>

#include <CLI/CLI.hpp>
#include <nlohmann/json.hpp>

#include "cli/bench/align_bench.h"
#include "cli/format.h"
#include "cli/report/plot.h"
#include "cli/seed_option.h"
#include "core/file.h"
#include "core/image_file.h"

namespace lightstage::cli {

namespace {

using nlohmann::ordered_json;

struct Options {
  MovingPassOptions pass;
  std::size_t directions = 40;
  std::size_t heads = 20;
  std::vector<std::filesystem::path> faces;
  std::filesystem::path out;
};

const char* to_text(align::Between between) {
  return between == align::Between::kLinear ? "linear" : "catmull-rom";
}

// What `align` does unless told otherwise first, then one knob changed at a time.
std::vector<AlignKnobs> settings() {
  const AlignKnobs usual;
  std::vector<AlignKnobs> all{usual};
  for (const auto& [name, flow] : align::kFlowPresets) {
    for (const int shrink : {1, 2, 4}) {
      if (flow == usual.flow && shrink == usual.shrink) continue;
      if (shrink == 4 && flow != usual.flow) continue;
      all.push_back({.flow = flow, .shrink = shrink, .every = usual.every, .between = usual.between});
    }
  }
  for (const align::Between between : {align::Between::kLinear, align::Between::kCatmullRom}) {
    for (const int every : {3, 5, 11, 21, 40}) {
      if (every == usual.every && between == usual.between) continue;
      all.push_back({.flow = usual.flow, .shrink = usual.shrink, .every = every, .between = between});
    }
  }
  return all;
}

// Other subjects' motion, aligned as `align` does it: farther, larger, and of other kinds.
struct Case {
  const char* name;
  int pixels_times;  // of the pass's
  double motion_times;
  MotionKind kind;
};
constexpr Case kCases[] = {{"sways a third as far", 1, 1.0 / 3, MotionKind::kSway},
                           {"sways twice as far", 1, 2, MotionKind::kSway},
                           {"turns on the spot", 1, 1, MotionKind::kTurn},
                           {"shifts without turning", 1, 1, MotionKind::kShift},
                           {"sways, in a picture twice as large", 2, 2, MotionKind::kSway}};

std::string frontier_plot(const std::vector<AlignRow>& rows) {
  PlotPanel median{"median", {"seconds of flow for the pass", true}, {"end-point error, pixels", true}, {}};
  PlotPanel p95{"95 %", {"seconds of flow for the pass", true}, {"end-point error, pixels", true}, {}};
  for (const AlignRow& row : rows) {
    const std::string name(align::name_of(row.knobs.flow));
    const std::string label = "at 1/" + std::to_string(row.knobs.shrink) + ", every " +
                              std::to_string(row.knobs.every) + ", " + to_text(row.knobs.between);
    median.series.push_back({name, {{row.seconds, row.median_epe_px, label}}, false});
    p95.series.push_back({name, {{row.seconds, row.p95_epe_px, label}}, false});
  }
  return svg_plots({median, p95}, 2);
}

ordered_json json_of(const BlinkRow& row) {
  return {{"sound_frames", row.sound_frames},
          {"false_alarms", row.false_alarms},
          {"blinks", row.blinks},
          {"found", row.found},
          {"accused", row.accused}};
}

std::string text_of(const BlinkRow& row, const std::string& what) {
  return "  " + what + ": " + std::to_string(row.found) + " of " + std::to_string(row.blinks) + " found, " +
         std::to_string(row.accused) + " sound frames accused beside them; " + std::to_string(row.false_alarms) +
         " of " + std::to_string(row.sound_frames) + " frames of sound passes accused\n";
}

void run(const Options& options, Context& context) {
  if (!options.out.empty()) core::make_folder(options.out);
  const MovingPass pass(options.pass);
  align::MotionTrack motion;
  std::vector<AlignRow> rows;
  for (const AlignKnobs& knobs : settings()) rows.push_back(track_pass(pass, knobs, rows.empty() ? &motion : nullptr));
  const AlignRow& usual = rows.front();
  const BlendingGain gain = blending_gain(pass, motion, options.directions);
  const StillRow still = still_subject(options.pass, usual.knobs);

  const BlinkRow blinking = blinks(options.pass, usual.knobs, options.heads);
  MovingPassOptions turning = options.pass;
  turning.kind = MotionKind::kTurn;
  const BlinkRow blinking_turned = blinks(turning, usual.knobs, options.heads);

  std::vector<std::vector<std::string>> case_cells{
      {"the subject", "pixels", "motion px", "median px", "95 % px", "believed %", "masked %"}};
  ordered_json cases = ordered_json::array();
  for (const Case& other : kCases) {
    MovingPassOptions changed = options.pass;
    changed.pixels *= other.pixels_times;
    changed.motion_px *= other.motion_times;
    changed.kind = other.kind;
    const MovingPass moved(changed);
    const AlignRow row = track_pass(moved, usual.knobs);
    case_cells.push_back({other.name, std::to_string(changed.pixels), fixed(moved.motion_px(), 1),
                          fixed(row.median_epe_px, 3), fixed(row.p95_epe_px, 3), fixed(100 * row.believed, 1),
                          fixed(100 * row.masked, 2)});
    cases.push_back({{"name", other.name},
                     {"pixels", changed.pixels},
                     {"motion_px", moved.motion_px()},
                     {"median_epe_px", row.median_epe_px},
                     {"p95_epe_px", row.p95_epe_px},
                     {"believed", row.believed},
                     {"masked", row.masked}});
  }

  ordered_json frontier = ordered_json::array();
  std::vector<std::vector<std::string>> cells{
      {"flow", "size", "every", "between", "seconds", "median px", "95 % px", "believed %", "masked %"}};
  for (const AlignRow& row : rows) {
    const std::string flow(align::name_of(row.knobs.flow));
    cells.push_back({flow, "1/" + std::to_string(row.knobs.shrink), std::to_string(row.knobs.every),
                     to_text(row.knobs.between), fixed(row.seconds, 2), fixed(row.median_epe_px, 3),
                     fixed(row.p95_epe_px, 3), fixed(100 * row.believed, 1), fixed(100 * row.masked, 2)});
    frontier.push_back({{"knobs",
                         {{"flow", flow},
                          {"shrink", row.knobs.shrink},
                          {"every", row.knobs.every},
                          {"between", to_text(row.knobs.between)}}},
                        {"seconds", row.seconds},
                        {"error", row.median_epe_px},
                        {"p95_error", row.p95_epe_px},
                        {"believed", row.believed},
                        {"masked", row.masked}});
  }
  std::vector<std::vector<std::string>> face_cells{{"faces", "pictures", "not registered", "moved px", "residual px",
                                                    "then", "mean sharper by", "known shifts: median px", "95 % px"}};
  ordered_json faces = ordered_json::array();
  const auto add_faces = [&](const FacesRow& row) {
    const bool has_means = !row.mean_before.empty();
    face_cells.push_back({row.name, std::to_string(row.pictures), std::to_string(row.objected),
                          fixed(row.median_motion_px, 2), fixed(row.residual_before_px, 2),
                          fixed(row.residual_after_px, 2), has_means ? fixed(row.sharpness_gain, 2) : "-",
                          fixed(row.injected_median_px, 2), fixed(row.injected_p95_px, 2)});
    faces.push_back({{"name", row.name},
                     {"pictures", row.pictures},
                     {"not_registered", row.objected},
                     {"median_motion_px", row.median_motion_px},
                     {"residual_before_px", row.residual_before_px},
                     {"residual_after_px", row.residual_after_px},
                     {"sharpness_gain", has_means ? ordered_json(row.sharpness_gain) : ordered_json()},
                     {"known_shift_median_px", row.injected_median_px},
                     {"known_shift_p95_px", row.injected_p95_px}});
  };
  double registering_seconds = 0;
  add_faces(register_simulated(options.pass.seed, registering_seconds));
  for (const std::filesystem::path& folder : options.faces) {
    const FacesRow row = register_faces(folder);
    add_faces(row);
    if (options.out.empty() || row.mean_before.empty()) continue;
    core::write_image(options.out / (row.name + "-mean-before.png"), row.mean_before);
    core::write_image(options.out / (row.name + "-mean-after.png"), row.mean_after);
  }
  const ordered_json json{{"lights", options.pass.lights},
                          {"pixels", options.pass.pixels},
                          {"motion_px", pass.motion_px()},
                          {"every", usual.knobs.every},
                          {"median_epe_px", usual.median_epe_px},
                          {"p95_epe_px", usual.p95_epe_px},
                          {"psnr_unaligned_db", gain.unaligned_db},
                          {"psnr_aligned_db", gain.aligned_db},
                          {"psnr_still_db", gain.still_db},
                          {"psnr_gain_db", gain.aligned_db - gain.unaligned_db},
                          {"static_median_px", still.median_px},
                          {"static_p95_px", still.p95_px},
                          {"static_flow_p95_px", still.raw_p95_px},
                          {"hidden", gain.hidden},
                          {"masked", usual.masked},
                          {"error_hidden", gain.error_hidden},
                          {"error_shown", gain.error_shown},
                          {"blinks", json_of(blinking)},
                          {"blinks_turning", json_of(blinking_turned)},
                          {"cases", cases},
                          {"faces", faces},
                          {"frontier", frontier}};
  std::string text =
      "A simulated head that moves up to " + fixed(pass.motion_px(), 1) + " px, a tracking frame every " +
      std::to_string(usual.knobs.every) + "th, as `align` does it\n  end-point error " + fixed(usual.median_epe_px, 3) +
      " px median, " + fixed(usual.p95_epe_px, 3) + " px 95 %\n  linear blending: " + fixed(gain.unaligned_db, 2) +
      " dB as taken, " + fixed(gain.aligned_db, 2) + " dB aligned, " + fixed(gain.still_db, 2) +
      " dB had it stood still (PSNR against the truth between the lights)\n  a subject that stands still: " +
      fixed(still.median_px, 3) + " px median, " + fixed(still.p95_px, 3) + " px 95 % (flow alone " +
      fixed(still.raw_p95_px, 3) + ")\n  hidden in a frame: " + fixed(100 * gain.hidden, 2) +
      " % of the subject, in some frame and so masked: " + fixed(100 * usual.masked, 2) + " %; display values err by " +
      fixed(gain.error_hidden, 3) + " there, by " + fixed(gain.error_shown, 3) + " where they are shown\n" +
      text_of(blinking, "blinks") + text_of(blinking_turned, "of heads that turn on the spot") + "\n" +
      table(case_cells) + "\n" + table(cells);
  text += "\nRegistered without tracking frames (the simulated head, of 1024 pixels a side, in " +
          fixed(registering_seconds, 1) + " s)\n" + table(face_cells);
  if (!options.out.empty()) {
    core::write_file_atomically(options.out / "align.json", json.dump(1) + "\n");
    core::write_file_atomically(options.out / "align.txt", text);
    core::write_file_atomically(options.out / "align.svg", frontier_plot(rows));
    text += "\nwrote " + (options.out / "align.json").string() + ", align.txt and align.svg\n";
  }
  context.result(text, json);
}

}  // namespace

void add_bench_align(CLI::App& bench, Context& context) {
  const auto options = std::make_shared<Options>();
  CLI::App* command = bench.add_subcommand(
      "align",
      "Alignment on a simulated moving head: end-point errors, what blending gains, time against error of "
      "every flow method, working size and tracking period");
  command->fallthrough();
  command->add_option("--lights", options->pass.lights, "Lights of the stage, a frame each")
      ->capture_default_str()
      ->check(CLI::Range(30, 4096));
  command->add_option("--size", options->pass.pixels, "Pixels a side of the square picture")
      ->capture_default_str()
      ->check(CLI::Range(64, 4096));
  command->add_option("--motion", options->pass.motion_px, "Pixels that the subject moves")
      ->capture_default_str()
      ->check(CLI::Range(0.5, 40.0));
  command->add_option("--seed", options->pass.seed, "Seed of head, motion and noise")
      ->capture_default_str()
      ->check(seed_number());
  command->add_option("--heads", options->heads, "Heads among whose tracking frames blinks are looked for")
      ->capture_default_str()
      ->check(CLI::Range(1, 1000));
  command->add_option("--faces", options->faces,
                      "Also register photographs under different lights: folders of the Extended Yale Face Database B");
  command->add_option("--out", options->out, "Also write the table, and a plot, into this folder");
  command->footer("Example:\n  lightstage bench align --json");
  command->callback([options, &context] { run(*options, context); });
}

}  // namespace lightstage::cli
