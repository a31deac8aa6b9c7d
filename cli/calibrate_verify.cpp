#include "cli/calibrate_verify.h"

#include <CLI/CLI.hpp>
#include <nlohmann/json.hpp>

#include "cli/context.h"
#include "cli/format.h"
#include "cli/jobs/verify_calibration.h"
#include "cli/options.h"

namespace lightstage::cli {

namespace {

struct Options {
  std::string scan;
  double ball_radius_mm = 60;
};

void run_verify(const Options& options, const Context& context) {
  const db::Store store = context.open_store();
  const VerifyCalibrationReport report = verify_calibration(store, options.scan, options.ball_radius_mm / 1000);
  std::string text = std::to_string(report.compared) + " highlights against the calibration of " +
                     report.calibrated_utc + ": median " + fixed(report.median_px, 3) + " px, " +
                     fixed(report.median_degrees, 3) + " degrees; 95 % within " + fixed(report.p95_px, 3) + " px, " +
                     fixed(report.p95_degrees, 3) + " degrees\n";
  nlohmann::ordered_json residuals = nlohmann::ordered_json::array();
  for (const HighlightResidual& residual : report.residuals) {
    nlohmann::ordered_json object{{"light", residual.light_index}, {"camera", residual.camera}};
    if (residual.compared) {
      object["px"] = residual.px;
      object["degrees"] = residual.degrees;
      object["promised_deg"] = residual.promised_degrees;
    } else {
      object["reason"] = residual.reason;
    }
    residuals.push_back(object);
  }
  for (const int light : report.moved) text += "  light " + std::to_string(light) + " has moved\n";
  text += report.advice + "\n";
  context.result(text, {{"compared", report.compared},
                        {"median_px", report.median_px},
                        {"p95_px", report.p95_px},
                        {"median_deg", report.median_degrees},
                        {"p95_deg", report.p95_degrees},
                        {"median_ratio", report.median_ratio},
                        {"moved", report.moved},
                        {"recalibrate", report.recalibrate},
                        {"advice", report.advice},
                        {"residuals", residuals}});
}

}  // namespace

void add_calibrate_verify(CLI::App& calibrate, Context& context) {
  CLI::App* command = calibrate.add_subcommand("verify", "Whether the stage's calibration predicts another ball pass");
  command->footer("Example:\n  lightstage calibrate verify ball2");
  auto options = std::make_shared<Options>();
  command->add_option("SCAN", options->scan, "A mirror-ball pass that the calibration was not made from")->required();
  command->add_option("--ball-radius", options->ball_radius_mm, "Radius of the mirror ball, millimetres")
      ->capture_default_str()
      ->check(number_between(5.0, 500.0));
  command->callback([options, &context] { run_verify(*options, context); });
}

}  // namespace lightstage::cli
