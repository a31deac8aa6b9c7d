#include <CLI/CLI.hpp>
#include <nlohmann/json.hpp>

#include "cli/calibrate_cameras.h"
#include "cli/calibrate_colour.h"
#include "cli/calibrate_flat.h"
#include "cli/calibrate_lights.h"
#include "cli/calibrate_linearity.h"
#include "cli/calibrate_response.h"
#include "cli/calibrate_verify.h"
#include "cli/commands.h"
#include "cli/format.h"
#include "cli/jobs/calibrate.h"
#include "cli/options.h"
#include "cli/report/light_files.h"
#include "core/error.h"
#include "core/light_list.h"

namespace lightstage::cli {

namespace {

struct Options {
  CalibrateOptions job;
  double ball_radius_mm = 60, grey_radius_mm = 60;
  std::string grey;
  std::filesystem::path lp, out;
};

nlohmann::ordered_json xyz(core::Vec3 v) {
  return nlohmann::ordered_json::array({v.x, v.y, v.z});
}

nlohmann::ordered_json placed_light(const db::CalibratedLight& light, const PlacedLight& seen,
                                    const CalibrateReport& report) {
  const auto gain_sigma = report.gain_sigma.find(light.light_index);
  return {{"light", light.light_index},
          {"direction", xyz(light.light.direction.vec())},
          {"sigma_deg", light.sigma_degrees},
          {"position", xyz(*light.light.position)},
          {"sigma_m", seen.sigma_m},
          {"gain", light.light.gain},
          {"gain_sigma", gain_sigma == report.gain_sigma.end() ? nlohmann::ordered_json(nullptr)
                                                               : nlohmann::ordered_json(gain_sigma->second)},
          {"reason", light.reason}};
}

void run_calibrate(Options options, Context& context) {
  options.job.mirror_radius_m = options.ball_radius_mm / 1000;
  options.job.grey_radius_m = options.grey_radius_mm / 1000;
  if (!options.grey.empty()) options.job.grey_ball = options.grey;
  db::Store store = context.open_store();
  store.require_writable();
  const CalibrateReport report = calibrate(store, options.job);

  const LightsReport& joined = report.joined;
  nlohmann::ordered_json unplaced = nlohmann::ordered_json::array(), placed = unplaced;
  std::vector<core::LpEntry> entries;
  std::string text = "placed " + std::to_string(joined.used) + " of " + std::to_string(report.lights.size()) +
                     " lights; median standard error " + fixed(joined.median_sigma_degrees, 3) + " degrees, " +
                     fixed(1000 * joined.median_sigma_m, 1) + " mm\n";
  for (std::size_t i = 0; i < report.lights.size(); ++i) {
    const db::CalibratedLight& light = report.lights[i];
    if (light.placed) {
      entries.push_back({report.sources.names[i], light.light.direction});
      placed.push_back(placed_light(light, joined.lights[i], report));
    } else {
      text += "  light " + std::to_string(light.light_index) + " not placed: " + light.reason + "\n";
      unplaced.push_back({{"light", light.light_index}, {"reason", light.reason}});
    }
  }
  if (report.gains_from) {
    text += "no grey-ball pass (--grey): gains kept from the calibration of " + *report.gains_from + "\n";
  } else if (!report.gains_measured) {
    text += "no grey-ball pass (--grey): all lights are taken as equally strong\n";
  }
  if (!options.lp.empty()) {
    core::write_lp(options.lp, entries);
    text += "wrote " + options.lp.string() + "\n";
  }
  if (!options.out.empty()) {
    write_light_files(options.out, report.sources, joined);
    text += "wrote lights.lp, lights.dome, lights.csv and lights.png to " + options.out.string() + "\n";
  }
  context.result(text, {{"lights", report.lights.size()},
                        {"placed", joined.used},
                        {"median_sigma_deg", joined.median_sigma_degrees},
                        {"median_sigma_m", joined.median_sigma_m},
                        {"rms_px", or_null(joined.rms_px)},
                        {"gains_measured", report.gains_measured},
                        {"gains_from", or_null(report.gains_from)},
                        {"not_placed", unplaced},
                        {"placed_lights", placed}});
}

}  // namespace

void add_calibrate(CLI::App& program, Context& context) {
  CLI::App* command = program.add_subcommand("calibrate", "Light directions and gains of a stage, from ball passes");
  command->footer("Example:\n  lightstage calibrate ball ball_aside --grey grey --out lights");
  auto options = std::make_shared<Options>();
  command->add_option("SCAN", options->job.mirror_balls,
                      "Mirror-ball passes, one or more; with the ball in several places lights have positions too");
  command->add_option("--grey", options->grey, "Grey-ball pass, for the lights' brightness and colour");
  command->add_option("--ball-radius", options->ball_radius_mm, "Radius of the mirror ball, millimetres")
      ->capture_default_str()
      ->check(number_between(5.0, 500.0));
  command->add_option("--grey-radius", options->grey_radius_mm, "Radius of the grey ball, millimetres")
      ->capture_default_str()
      ->check(number_between(5.0, 500.0));
  command->add_option("--albedo", options->job.grey_albedo, "Albedo of the grey ball")
      ->capture_default_str()
      ->check(number_between(0.01, 1.0));
  command->add_option("--name", options->job.name, "Name of the calibration");
  command->add_option("--lp", options->lp, "Also write the directions as an RTI .lp file");
  command->add_option("--out", options->out, "Folder for lights.lp, lights.dome, lights.csv and lights.png");
  command->callback([command, options, &context] {
    if (!command->get_subcommands().empty()) return;
    if (options->job.mirror_balls.empty())
      throw core::UsageError("calibrate: name one or more mirror-ball passes (SCAN), or a subcommand");
    run_calibrate(*options, context);
  });
  add_calibrate_lights(*command, context);
  add_calibrate_verify(*command, context);
  add_calibrate_cameras(*command, context);
  add_calibrate_board(*command, context);
  add_calibrate_flat(*command, context);
  add_calibrate_colour(*command, context);
  add_calibrate_linearity(*command, context);
  add_calibrate_response(*command, context);
}

}  // namespace lightstage::cli
