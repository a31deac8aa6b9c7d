#include "cli/jobs/verify_calibration.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <set>

#include <nlohmann/json.hpp>

#include "calib/light_bundle.h"
#include "calib/mirror_ball.h"
#include "calib/shading.h"
#include "cli/format.h"
#include "cli/jobs/ball_pass.h"
#include "cli/jobs/stage_cameras.h"
#include "cli/jobs/stored_json.h"
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

// The median of a difference in two coordinates, in units of its standard error in both together.
constexpr double kMedianOfRayleigh = 0.8326;
constexpr double kLargestExcess = 2;

void advise(VerifyCalibrationReport& report) {
  const auto again = [&](const std::string& why) {
    report.recalibrate = true;
    report.advice += (report.advice.empty() ? "" : "; ") + why;
  };
  const char* with =
      report.by_grey_ball ? "calibrate again, with this pass as --grey" : "calibrate again, with this pass too";
  if (report.median_ratio > kLargestExcess * kMedianOfRayleigh && !report.by_grey_ball) {
    again(std::string("the differences are larger than promised: ") + with);
  } else if (!report.moved.empty()) {
    again(std::to_string(report.moved.size()) + (report.moved.size() == 1 ? " light has" : " lights have") +
          " moved: see to the mounts and calibrate again");
  }
  if (!report.by_grey_ball) {
    if (report.advice.empty()) report.advice = "the calibration holds";
    return;
  }
  const double common = (report.common_gain[0] + report.common_gain[1] + report.common_gain[2]) / 3 - 1;
  if (std::abs(common) > kChangedShare) {
    again("all lights together are " + fixed(100 * std::abs(common), 1) + (common < 0 ? " % dimmer" : " % brighter") +
          ": look at aperture, exposure and the lamps' supply, or " + with);
  }
  if (!report.changed.empty()) {
    again(std::to_string(report.changed.size()) + (report.changed.size() == 1 ? " light has" : " lights have") +
          " changed brightness or colour: " + with);
  }
  if (report.advice.empty()) report.advice = "the calibration holds";
}

// The calibration that is looked at, and what of its making is needed.
struct Calibration {
  std::map<int, db::CalibratedLight> lights;
  std::map<int, double> gain_sigma;  // relative
  double grey_albedo = 0;            // 0: gains were not measured
};

Calibration read_calibration(const db::Store& store, const db::Product& product) {
  Calibration calibration;
  for (const db::CalibratedLight& light : store.calibrated_lights(product.id)) {
    calibration.lights[light.light_index] = light;
  }
  const nlohmann::json parameters = nlohmann::json::parse(product.parameters, nullptr, false);
  if (!parameters.is_object()) return calibration;
  reading_json("calibration " + std::to_string(product.id), [&] {
    if (parameters.value("gains_measured", false)) calibration.grey_albedo = parameters.value("grey_albedo", 0.0);
    calibration.gain_sigma = parameters.value("gain_sigma", std::map<int, double>{});
  });
  return calibration;
}

// The light, or nothing and the reason why it cannot be compared.
const db::CalibratedLight* light_of(const Calibration& calibration, LightResidual& residual) {
  const auto light = calibration.lights.find(residual.light_index);
  if (light != calibration.lights.end() && light->second.placed && light->second.light.position) return &light->second;
  residual.reason = "the calibration did not place it";
  return nullptr;
}

void compare_highlight(const calib::BallPicture& picture, const BallView& view, const db::CalibratedLight& light,
                       LightResidual& residual) {
  const calib::LightEstimate seen = calib::estimate_light(picture, view.camera, view.ball, norm(*light.light.position));
  if (!seen.placed) {
    residual.reason = seen.reason;
    return;
  }
  const auto predicted = calib::predict_highlight(view.camera, view.ball, *light.light.position);
  if (!predicted) {
    residual.reason = "the ball should hide it";
    return;
  }
  residual.compared = true;
  residual.px = std::hypot(predicted->x - seen.highlight->position.x, predicted->y - seen.highlight->position.y);
  residual.degrees = core::degrees_from_radians(core::angle_radians(light.light.direction, seen.direction));
  residual.promised_degrees = std::hypot(light.sigma_degrees, seen.sigma_degrees);
}

void compare_grey(const calib::BallPicture& picture, const BallView& view, const Calibration& calibration,
                  const db::CalibratedLight& light, LightResidual& residual) {
  const calib::ShadingResidual seen =
      calib::compare_shading(picture.image, view.camera, view.ball, calibration.grey_albedo,
                             {*light.light.position, light.light.gain}, picture.saturation);
  residual.compared = seen.compared;
  residual.reason = seen.reason;
  const auto sigma = calibration.gain_sigma.find(light.light_index);
  if (seen.compared && sigma == calibration.gain_sigma.end()) {
    residual.compared = false;
    residual.reason = "its gain was not measured";
  }
  if (!residual.compared) return;
  residual.degrees = seen.degrees;
  residual.promised_degrees = std::hypot(light.sigma_degrees, seen.degrees_sigma);
  residual.gain_ratio = seen.gain_ratio;
  residual.promised_gain = std::hypot(sigma->second, seen.gain_sigma);
  residual.shading = seen.residual;
}

// Every light of the pass in the camera.
void compare_view(const db::Store& store, const db::Scan& scan, const capture::StageCamera& camera,
                  const Calibration& calibration, double radius_m, core::Progress& progress,
                  VerifyCalibrationReport& report) {
  const BallView view = view_ball(store, scan, camera, radius_m);
  for (std::size_t i = 0; i < view.light_frames.size(); ++i) {
    core::throw_if_interrupted();
    progress.advance();
    LightResidual residual;
    residual.light_index = view.light_index[i];
    residual.camera = camera.name;
    if (const db::CalibratedLight* light = light_of(calibration, residual)) {
      const calib::BallPicture picture = picture_of_light(store, view, i);
      if (report.by_grey_ball) {
        compare_grey(picture, view, calibration, *light, residual);
      } else {
        compare_highlight(picture, view, *light, residual);
      }
    }
    report.residuals.push_back(residual);
  }
}

// By how much the channel that is farthest off differs from what all lights share.
double worst_channel(const LightResidual& residual, const std::array<double, 3>& common) {
  double worst = 0;
  for (std::size_t c = 0; c < 3; ++c) worst = std::max(worst, std::abs(residual.gain_ratio[c] / common[c] - 1));
  return worst;
}

std::string what_changed(const LightResidual& residual, const std::array<double, 3>& common) {
  constexpr double kDarkShare = 0.01;
  std::array<double, 3> ratio;
  for (std::size_t c = 0; c < 3; ++c) ratio[c] = residual.gain_ratio[c] / common[c];
  const double mean = (ratio[0] + ratio[1] + ratio[2]) / 3;
  if (mean < kDarkShare) return "is dark";
  double colour = 0;
  for (const double r : ratio) colour = std::max(colour, std::abs(r / mean - 1));
  const std::string brightness = fixed(100 * std::abs(mean - 1), 1) + (mean < 1 ? " % dimmer" : " % brighter");
  if (colour <= std::max(kChangedShare, kChangedSigmas * residual.promised_gain)) return "is " + brightness;
  return "has changed its colour by " + fixed(100 * colour, 1) + " % and is " + brightness;
}

void summarise_gains(VerifyCalibrationReport& report) {
  std::array<std::vector<double>, 3> ratios;
  std::vector<double> shading, errors;
  for (const LightResidual& residual : report.residuals) {
    if (!residual.compared) continue;
    for (std::size_t c = 0; c < 3; ++c) ratios[c].push_back(residual.gain_ratio[c]);
    shading.push_back(residual.shading);
  }
  for (std::size_t c = 0; c < 3; ++c) report.common_gain[c] = share_of(ratios[c], 0.5);
  for (const LightResidual& residual : report.residuals) {
    if (!residual.compared) continue;
    errors.push_back(worst_channel(residual, report.common_gain));
    if (errors.back() > std::max(kChangedShare, kChangedSigmas * residual.promised_gain)) {
      report.changed.push_back({residual.light_index, residual.gain_ratio, what_changed(residual, report.common_gain)});
    }
  }
  report.median_gain_error = share_of(errors, 0.5);
  report.p95_gain_error = share_of(errors, 0.95);
  report.median_shading = share_of(shading, 0.5);
  report.p95_shading = share_of(shading, 0.95);
}

}  // namespace

VerifyCalibrationReport verify_calibration(const db::Store& store, const std::string& pass, double radius_m) {
  const db::Scan scan = store.scan(pass);
  if (scan.kind != db::ScanKind::kMirrorBall && scan.kind != db::ScanKind::kGreyBall) {
    throw core::UsageError("scan '" + pass + "' is " + std::string(db::to_string(scan.kind)) +
                           ", not a pass of a mirror ball or a grey ball");
  }
  const std::optional<db::Product> product = store.newest_calibration(scan.stage_key);
  if (!product) {
    throw core::UsageError("the stage of scan '" + pass + "' has no calibration to verify; `calibrate` makes one");
  }
  if (std::find(product->input_scans.begin(), product->input_scans.end(), scan.id) != product->input_scans.end()) {
    throw core::UsageError("the newest calibration was made from scan '" + pass +
                           "' itself; verify it with another ball pass");
  }
  const Calibration calibration = read_calibration(store, *product);
  VerifyCalibrationReport report;
  report.by_grey_ball = scan.kind == db::ScanKind::kGreyBall;
  if (report.by_grey_ball && !(calibration.grey_albedo > 0)) {
    throw core::UsageError("the newest calibration knows no gains; calibrate with `--grey " + pass + "`");
  }
  report.calibration_id = product->id;
  report.calibrated_utc = product->created_utc;
  const capture::Stage stage = calibrated_provenance(store, scan).stage;
  const std::size_t cameras = report.by_grey_ball ? 1 : stage.cameras.size();
  core::Progress progress("comparing lights", stage.light_positions.size() * cameras);
  for (std::size_t c = 0; c < cameras; ++c) {
    compare_view(store, scan, stage.cameras[c], calibration, radius_m, progress, report);
  }

  const double moved_degrees = report.by_grey_ball ? kMovedDegreesByShading : kMovedDegrees;
  std::vector<double> pixels, degrees, ratios;
  std::set<int> moved;
  for (const LightResidual& residual : report.residuals) {
    if (!residual.compared) continue;
    ++report.compared;
    if (residual.promised_degrees >= 180) continue;  // a dark ball
    pixels.push_back(residual.px);
    degrees.push_back(residual.degrees);
    ratios.push_back(residual.degrees / std::max(1e-9, residual.promised_degrees));
    if (ratios.back() > kMovedSigmas && residual.degrees > moved_degrees) moved.insert(residual.light_index);
  }
  if (report.compared == 0) {
    throw core::BadInput("no light of scan '" + pass + "' could be compared (first reason: " +
                         (report.residuals.empty() ? "no light frames" : report.residuals.front().reason) + ")");
  }
  report.median_px = share_of(pixels, 0.5);
  report.p95_px = share_of(pixels, 0.95);
  report.median_degrees = share_of(degrees, 0.5);
  report.p95_degrees = share_of(degrees, 0.95);
  report.median_ratio = share_of(ratios, 0.5);
  report.moved.assign(moved.begin(), moved.end());
  if (report.by_grey_ball) summarise_gains(report);
  advise(report);
  return report;
}

}  // namespace lightstage::cli
