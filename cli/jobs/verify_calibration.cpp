#include "cli/jobs/verify_calibration.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <set>

#include "calib/light_bundle.h"
#include "calib/mirror_ball.h"
#include "cli/jobs/ball_pass.h"
#include "cli/jobs/stage_cameras.h"
#include "core/error.h"
#include "core/interrupt.h"
#include "core/progress.h"
#include "db/scan_loader.h"

namespace lightstage::cli {

namespace {

// Nearest rank; 0 for none.
double share_of(std::vector<double> values, double share) {
  if (values.empty()) return 0;
  std::sort(values.begin(), values.end());
  return values[std::size_t(std::lround(share * double(values.size() - 1)))];
}

void advise(VerifyCalibrationReport& report) {
  // The median of a difference in two coordinates, in units of its standard error in both together.
  constexpr double kMedianOfRayleigh = 0.8326;
  constexpr double kLargestExcess = 2;
  if (report.median_ratio > kLargestExcess * kMedianOfRayleigh) {
    report.recalibrate = true;
    report.advice = "the differences are larger than promised: calibrate again, with this pass too";
  } else if (!report.moved.empty()) {
    report.recalibrate = true;
    report.advice = std::to_string(report.moved.size()) + " lights have moved: see to their mounts and calibrate again";
  } else {
    report.advice = "the calibration holds";
  }
}

}  // namespace

VerifyCalibrationReport verify_calibration(const db::Store& store, const std::string& mirror_pass, double radius_m) {
  const db::Scan scan = ball_pass(store, mirror_pass, db::ScanKind::kMirrorBall, "mirror ball");
  const std::optional<db::Product> calibration = store.newest_calibration(scan.stage_key);
  if (!calibration) {
    throw core::UsageError("the stage of scan '" + mirror_pass +
                           "' has no calibration to verify; `calibrate` makes one");
  }
  if (std::find(calibration->input_scans.begin(), calibration->input_scans.end(), scan.id) !=
      calibration->input_scans.end()) {
    throw core::UsageError("the newest calibration was made from scan '" + mirror_pass +
                           "' itself; verify it with another ball pass");
  }
  std::map<int, db::CalibratedLight> lights;
  for (const db::CalibratedLight& light : store.calibrated_lights(calibration->id)) lights[light.light_index] = light;

  VerifyCalibrationReport report;
  report.calibration_id = calibration->id;
  report.calibrated_utc = calibration->created_utc;
  std::vector<double> pixels, degrees, ratios;
  std::set<int> moved;
  const CaptureProvenance provenance = calibrated_provenance(store, scan);
  core::Progress progress("highlights", provenance.stage.light_positions.size() * provenance.stage.cameras.size());
  for (const capture::StageCamera& camera : provenance.stage.cameras) {
    const BallView view = view_ball(store, scan, camera, radius_m);
    for (std::size_t i = 0; i < view.light_frames.size(); ++i) {
      core::throw_if_interrupted();
      progress.advance();
      HighlightResidual& residual = report.residuals.emplace_back();
      residual.light_index = view.light_index[i];
      residual.camera = camera.name;
      const auto light = lights.find(residual.light_index);
      if (light == lights.end() || !light->second.placed || !light->second.light.position) {
        residual.reason = "the calibration did not place it";
        continue;
      }
      const db::Frame& frame = view.light_frames[i];
      const calib::LightEstimate seen =
          calib::estimate_light({residual.light_index, db::load_frame(store, frame, view.dark), frame.saturation},
                                view.camera, view.ball, provenance.stage.radius_m);
      if (!seen.placed) {
        residual.reason = seen.reason;
        continue;
      }
      const auto predicted = calib::predict_highlight(view.camera, view.ball, *light->second.light.position);
      if (!predicted) {
        residual.reason = "the ball should hide it";
        continue;
      }
      residual.compared = true;
      residual.px = std::hypot(predicted->x - seen.highlight->position.x, predicted->y - seen.highlight->position.y);
      residual.degrees = core::degrees_from_radians(core::angle_radians(light->second.light.direction, seen.direction));
      residual.promised_degrees = std::hypot(light->second.sigma_degrees, seen.sigma_degrees);
      pixels.push_back(residual.px);
      degrees.push_back(residual.degrees);
      ratios.push_back(residual.degrees / std::max(1e-9, residual.promised_degrees));
      if (ratios.back() > kMovedSigmas && residual.degrees > kMovedDegrees) moved.insert(residual.light_index);
    }
  }
  report.compared = pixels.size();
  if (report.compared == 0) throw core::BadInput("no highlight of scan '" + mirror_pass + "' could be compared");
  report.median_px = share_of(pixels, 0.5);
  report.p95_px = share_of(pixels, 0.95);
  report.median_degrees = share_of(degrees, 0.5);
  report.p95_degrees = share_of(degrees, 0.95);
  report.median_ratio = share_of(ratios, 0.5);
  report.moved.assign(moved.begin(), moved.end());
  advise(report);
  return report;
}

}  // namespace lightstage::cli
