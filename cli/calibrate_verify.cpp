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

nlohmann::ordered_json residual_object(const LightResidual& residual, bool by_grey_ball) {
  nlohmann::ordered_json object{{"light", residual.light_index}, {"camera", residual.camera}};
  if (!residual.compared) {
    object["reason"] = residual.reason;
    return object;
  }
  if (by_grey_ball) {
    object["gain_ratio"] = residual.gain_ratio;
    object["promised_gain"] = residual.promised_gain;
    object["shading_percent"] = 100 * residual.shading;
  } else {
    object["px"] = residual.px;
  }
  object["degrees"] = residual.degrees;
  object["promised_deg"] = residual.promised_degrees;
  return object;
}

void run_verify(const Options& options, const Context& context) {
  const db::Store store = context.open_store();
  const VerifyCalibrationReport report = verify_calibration(store, options.scan, options.ball_radius_mm / 1000);
  nlohmann::ordered_json object{{"ball", report.by_grey_ball ? "grey" : "mirror"}, {"compared", report.compared}};
  std::string text = std::to_string(report.compared) + (report.by_grey_ball ? " lights' shadings" : " highlights") +
                     " against the calibration of " + report.calibrated_utc + ": ";
  if (report.by_grey_ball) {
    const double common = (report.common_gain[0] + report.common_gain[1] + report.common_gain[2]) / 3 - 1;
    text += "median " + fixed(100 * report.median_shading, 2) + " % of what is predicted, " +
            fixed(report.median_degrees, 3) + " degrees; 95 % within " + fixed(100 * report.p95_shading, 2) + " %, " +
            fixed(report.p95_degrees, 3) + " degrees\n  all lights together " + fixed(100 * common, 2) +
            " %; single ones off that by " + fixed(100 * report.median_gain_error, 2) +
            " % in the median, 95 % within " + fixed(100 * report.p95_gain_error, 2) + " %\n";
    object["median_percent"] = 100 * report.median_shading;
    object["p95_percent"] = 100 * report.p95_shading;
    object["common_gain"] = report.common_gain;
    object["median_gain_error"] = report.median_gain_error;
    object["p95_gain_error"] = report.p95_gain_error;
  } else {
    text += "median " + fixed(report.median_px, 3) + " px, " + fixed(report.median_degrees, 3) +
            " degrees; 95 % within " + fixed(report.p95_px, 3) + " px, " + fixed(report.p95_degrees, 3) + " degrees\n";
    object["median_px"] = report.median_px;
    object["p95_px"] = report.p95_px;
  }
  object["median_deg"] = report.median_degrees;
  object["p95_deg"] = report.p95_degrees;
  object["median_ratio"] = report.median_ratio;
  object["moved"] = report.moved;
  nlohmann::ordered_json changed = nlohmann::ordered_json::array();
  for (const ChangedLight& light : report.changed) {
    text += "  light " + std::to_string(light.light_index) + " " + light.what + "\n";
    changed.push_back({{"light", light.light_index}, {"gain_ratio", light.gain_ratio}, {"what", light.what}});
  }
  if (report.by_grey_ball) object["changed"] = changed;
  for (const int light : report.moved) text += "  light " + std::to_string(light) + " has moved\n";
  text += report.advice + "\n";
  object["recalibrate"] = report.recalibrate;
  object["advice"] = report.advice;
  object["residuals"] = nlohmann::ordered_json::array();
  for (const LightResidual& residual : report.residuals) {
    object["residuals"].push_back(residual_object(residual, report.by_grey_ball));
  }
  context.result(text, object);
}

}  // namespace

void add_calibrate_verify(CLI::App& calibrate, Context& context) {
  CLI::App* command = calibrate.add_subcommand("verify", "Whether the stage's calibration predicts another ball pass");
  command->footer("Example:\n  lightstage calibrate verify ball2");
  auto options = std::make_shared<Options>();
  command
      ->add_option("SCAN", options->scan, "A pass of a mirror ball or grey ball that the calibration was not made from")
      ->required();
  command->add_option("--ball-radius", options->ball_radius_mm, "Radius of the ball, millimetres")
      ->capture_default_str()
      ->check(number_between(5.0, 500.0));
  command->callback([options, &context] { run_verify(*options, context); });
}

}  // namespace lightstage::cli
