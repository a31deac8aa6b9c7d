#include "cli/bench/calib_command.h"

#include <memory>

#include <nlohmann/json.hpp>

#include "cli/bench/calib_report.h"
#include "cli/format.h"
#include "core/file.h"

namespace lightstage::cli {

namespace {

using nlohmann::ordered_json;

struct Options {
  std::size_t lights = 110;
  int stages = 3;
  int ball_px = 150;
  bool no_frontier = false;
  std::filesystem::path data, out;
};

BallStageOptions stage_of(const Options& options, int ball_px, int seed) {
  return {.lights = options.lights, .ball_px = ball_px, .seed = std::uint64_t(seed)};
}

// With the knobs that `calibrate` works with.
struct Summary {
  CalibRow placed;
  GainRow gains;
  double hdr_percent = 0;
};

Summary measure_summary(const Options& options) {
  std::vector<std::unique_ptr<BallStage>> stages;
  std::vector<const BallStage*> judged;
  std::vector<PlacedLights> found;
  for (int s = 1; s <= options.stages; ++s) {
    stages.push_back(std::make_unique<BallStage>(stage_of(options, options.ball_px, s)));
    judged.push_back(stages.back().get());
    found.push_back(place_lights(*stages.back(), {}));
  }
  return {judge({}, judged, found), measure_gains(*stages.front(), found.front().bundle.lights),
          hdr_linearity_percent()};
}

// The usual knobs first, then one turned at a time, all on one stage.
std::vector<CalibRow> light_frontier(const Options& options) {
  const CalibKnobs usual;
  std::vector<CalibKnobs> knobs{usual};
  for (const SpotMethod method : kSpotMethods) {
    for (const double clipping : {0.5, 3.0, 10.0, 30.0, 300.0}) {
      if (method != usual.method || clipping != usual.clipping) {
        knobs.push_back({.method = method, .clipping = clipping});
      }
    }
  }
  for (const int cameras : {1, 2}) {
    for (const int balls : {1, 2, 3}) {
      if (balls != usual.balls || cameras != usual.cameras) knobs.push_back({.balls = balls, .cameras = cameras});
    }
  }
  std::vector<CalibRow> rows;
  const auto add = [&](const BallStage& stage, const CalibKnobs& k) {
    rows.push_back(judge(k, {&stage}, {place_lights(stage, k)}));
  };
  const BallStage stage(stage_of(options, options.ball_px, 1));
  for (const CalibKnobs& k : knobs) add(stage, k);
  constexpr int kSmallestBallPx =
      30;  // below, the little that the pictures show around the ball is not enough for its outline
  for (const int ball_px : {options.ball_px / 4, options.ball_px / 2}) {
    if (ball_px < kSmallestBallPx) continue;
    const BallStage smaller(stage_of(options, ball_px, 1));
    for (const SpotMethod method : kSpotMethods) add(smaller, {.method = method});
  }
  return rows;
}

std::string text_of(const Options& options, const Summary& summary) {
  const CalibRow& all = summary.placed;
  const GainRow& gains = summary.gains;
  return std::to_string(options.stages) + (options.stages == 1 ? " simulated stage of " : " simulated stages of ") +
         std::to_string(options.lights) + " lights at 1.2 to 2.5 m, two mirror balls of " +
         std::to_string(options.ball_px) + " px in one camera with lens distortion, highlights clipped " +
         fixed(all.knobs.clipping, 0) + " times, 12 bits and 40 dB\n  directions " + fixed(all.median_degrees, 3) +
         " degrees median, " + fixed(all.p95_degrees, 3) + " 95 %; positions " + fixed(1000 * all.median_m, 2) +
         " mm median, " + fixed(1000 * all.p95_m, 2) + " 95 %; " + std::to_string(all.placed) + " of " +
         std::to_string(all.lights) + " placed\n  errors over standard errors: directions " +
         fixed(all.direction_ratio, 2) + ", positions " + fixed(all.position_ratio, 2) +
         "\n  gains from a grey ball: " + fixed(100 * gains.median_error, 2) + " % median, " +
         fixed(100 * gains.p95_error, 2) + " % 95 %, " + fixed(100 * gains.within_1_percent, 1) +
         " % within 1 %; over standard errors " + fixed(gains.ratio, 2) + "; " + std::to_string(gains.measured) +
         " of " + std::to_string(gains.lights) + " measured\n  merged exposures: " + fixed(summary.hdr_percent, 3) +
         " % from proportional at most, over 14 stops\n";
}

ordered_json json_of(const Options& options, const Summary& summary) {
  const CalibRow& all = summary.placed;
  const GainRow& gains = summary.gains;
  return {{"stages", options.stages},
          {"lights", all.lights},
          {"placed", all.placed},
          {"median_deg", all.median_degrees},
          {"p95_deg", all.p95_degrees},
          {"median_position_mm", 1000 * all.median_m},
          {"p95_position_mm", 1000 * all.p95_m},
          {"direction_error_over_sigma", all.direction_ratio},
          {"position_error_over_sigma", all.position_ratio},
          {"gains",
           {{"measured", gains.measured},
            {"lights", gains.lights},
            {"median_error", gains.median_error},
            {"p95_error", gains.p95_error},
            {"within_1_percent", gains.within_1_percent},
            {"error_over_sigma", gains.ratio}}},
          {"hdr_linearity_percent", summary.hdr_percent}};
}

void run(const Options& options, Context& context) {
  if (!options.out.empty()) core::make_folder(options.out);
  const Summary summary = measure_summary(options);
  std::vector<PhotographRow> photographed;
  std::vector<CalibRow> lights;
  std::vector<BracketRow> brackets;
  std::vector<BoardBenchRow> boards;
  if (!options.data.empty()) photographed = photographs(options.data);
  if (!options.no_frontier) {
    lights = light_frontier(options);
    brackets = bracket_frontier();
    boards = bench_boards();
  }
  std::string text = text_of(options, summary);
  ordered_json json = json_of(options, summary);
  const auto add = [&](const char* key, const std::string& heading, const RowsReport& rows) {
    json[key] = rows.json;
    if (!rows.text.empty()) text += "\n" + heading + "\n" + rows.text;
  };
  add("photographs", "Photographs", report(photographed));
  add("frontier", "Time against error: lights, on the first stage", report(lights));
  add("bracket_frontier", "Exposures merged", report(brackets));
  add("board_frontier", "Two cameras from rendered boards", report(boards));
  if (!options.out.empty()) {
    core::write_file_atomically(options.out / "calib.json", json.dump(1) + "\n");
    core::write_file_atomically(options.out / "calib.txt", text);
    std::string wrote = "calib.json and calib.txt";
    if (!options.no_frontier) {
      core::write_file_atomically(options.out / "calib.svg", frontier_plot(lights, brackets, boards));
      wrote = "calib.json, calib.txt and calib.svg";
    }
    text += "\nwrote " + wrote + " into " + options.out.string() + "\n";
  }
  context.result(text, json);
}

}  // namespace

void add_bench_calib(CLI::App& bench, Context& context) {
  const auto options = std::make_shared<Options>();
  CLI::App* command = bench.add_subcommand(
      "calib",
      "Calibration on simulated stages: errors of directions, positions and gains and whether their standard errors "
      "are honest; time against error of every highlight method, clipping, number of balls and cameras, and picture "
      "size, of brackets of exposures, and of cameras from boards");
  command->fallthrough();
  command->add_option("--lights", options->lights, "Lights of each stage")
      ->capture_default_str()
      ->check(CLI::Range(12, 4096));
  command->add_option("--stages", options->stages, "Stages, each of its own seed")
      ->capture_default_str()
      ->check(CLI::Range(1, 100));
  command->add_option("--ball-px", options->ball_px, "Radius of a ball's image, pixels")
      ->capture_default_str()
      ->check(CLI::Range(64, 1024));
  command
      ->add_option("--data", options->data,
                   "Also on photographs: a folder with psbox_two_mirror_balls and diligent_ball16, or one of them")
      ->check(CLI::ExistingDirectory);
  command->add_flag("--no-frontier", options->no_frontier,
                    "Only how good it is, and not time against error of every knob");
  command->add_option("--out", options->out, "Also write the tables, and a plot of the frontier, into this folder");
  command->footer("Example:\n  lightstage bench calib --json");
  command->callback([options, &context] { run(*options, context); });
}

}  // namespace lightstage::cli
