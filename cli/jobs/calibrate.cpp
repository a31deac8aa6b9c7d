#include "cli/jobs/calibrate.h"

#include <algorithm>

#include <nlohmann/json.hpp>

#include "calib/light_gain.h"
#include "calib/mirror_ball.h"
#include "cli/jobs/ball_pass.h"
#include "cli/jobs/stage_cameras.h"
#include "cli/options.h"
#include "core/error.h"
#include "core/interrupt.h"
#include "core/progress.h"
#include "db/scan_loader.h"

namespace lightstage::cli {

namespace {

std::vector<calib::LightEstimate> estimate_lights(const db::Store& store, const BallView& view, double stage_radius_m,
                                                  core::Progress& progress) {
  std::vector<calib::LightEstimate> estimates;
  for (std::size_t i = 0; i < view.light_frames.size(); ++i) {
    core::throw_if_interrupted();
    const db::Frame& frame = view.light_frames[i];
    const calib::BallPicture picture{view.light_index[i], db::load_frame(store, frame, view.dark), frame.saturation};
    estimates.push_back(calib::estimate_light(picture, view.camera, view.ball, stage_radius_m));
    progress.advance();
  }
  return estimates;
}

// Whether any light's gain could be measured; if none could, all stay 1.
bool measure_gains(const db::Store& store, const db::Scan& scan, const CalibrateOptions& options,
                   std::vector<db::CalibratedLight>& lights) {
  const CaptureProvenance provenance = calibrated_provenance(store, scan);
  const BallView view = view_ball(store, scan, provenance.stage.cameras.front(), options.grey_radius_m);
  core::Progress progress("light gains", view.light_frames.size());
  for (std::size_t i = 0; i < view.light_frames.size(); ++i) {
    core::throw_if_interrupted();
    progress.advance();
    const auto light = std::find_if(lights.begin(), lights.end(),
                                    [&](const db::CalibratedLight& l) { return l.light_index == view.light_index[i]; });
    if (light == lights.end() || !light->placed) continue;
    const db::Frame& frame = view.light_frames[i];
    const calib::GainEstimate estimate =
        calib::estimate_gain(db::load_frame(store, frame, view.dark), view.camera, view.ball, options.grey_albedo,
                             *light->light.position, frame.saturation);
    if (estimate.measured) {
      light->light.gain = estimate.gain;
    } else {
      light->reason = "gain taken as the median of the others: " + estimate.reason;
    }
  }
  // A light that the grey ball does not show to the camera (behind it) gets the typical gain.
  std::array<std::vector<double>, 3> measured;
  for (const db::CalibratedLight& light : lights) {
    if (light.placed && light.reason.empty()) {
      for (std::size_t c = 0; c < 3; ++c) measured[c].push_back(light.light.gain[c]);
    }
  }
  for (db::CalibratedLight& light : lights) {
    if (!light.placed || light.reason.empty() || measured[0].empty()) continue;
    for (std::size_t c = 0; c < 3; ++c) {
      auto& values = measured[c];
      const auto middle = values.begin() + std::ptrdiff_t(values.size() / 2);
      std::nth_element(values.begin(), middle, values.end());
      light.light.gain[c] = *middle;
    }
  }
  return !measured[0].empty();
}

// The gains of the stage's newest calibration, if they were measured, for lights that are placed in both.
void keep_gains(const db::Store& store, db::NewProduct& product, CalibrateReport& report) {
  const std::optional<db::Product> before = store.newest_calibration(product.stage_key);
  if (!before) return;
  const nlohmann::json parameters = nlohmann::json::parse(before->parameters, nullptr, false);
  const auto measured = parameters.is_object() ? parameters.find("gains_measured") : parameters.end();
  if (!parameters.is_object() || measured == parameters.end() || *measured != true) return;
  const std::vector<db::CalibratedLight> earlier = store.calibrated_lights(before->id);
  for (db::CalibratedLight& light : report.lights) {
    const auto same = std::find_if(earlier.begin(), earlier.end(), [&](const db::CalibratedLight& e) {
      return e.placed && e.light_index == light.light_index;
    });
    if (light.placed && same != earlier.end()) light.light.gain = same->light.gain;
  }
  product.input_products.push_back(before->id);
  report.gains_from = before->created_utc;
}

}  // namespace

CalibrateReport calibrate(db::Store& store, const CalibrateOptions& options) {
  db::NewProduct product;
  product.kind = "calibration";
  product.name = options.name;
  std::vector<std::vector<calib::LightEstimate>> per_view;
  for (const std::string& name : options.mirror_balls) {
    const db::Scan scan = ball_pass(store, name, db::ScanKind::kMirrorBall, "mirror ball");
    if (!product.stage_key.empty() && scan.stage_key != product.stage_key) {
      throw core::UsageError("scan '" + name + "' stands on another stage than '" + options.mirror_balls.front() + "'");
    }
    product.stage_key = scan.stage_key;
    product.input_scans.push_back(scan.id);
    const CaptureProvenance provenance = calibrated_provenance(store, scan);
    core::Progress progress("light directions",
                            provenance.stage.light_positions.size() * provenance.stage.cameras.size());
    for (const capture::StageCamera& camera : provenance.stage.cameras) {
      const BallView view = view_ball(store, scan, camera, options.mirror_radius_m);
      per_view.push_back(estimate_lights(store, view, provenance.stage.radius_m, progress));
    }
  }

  CalibrateReport report;
  std::vector<double> sigmas;
  for (const calib::LightEstimate& estimate : calib::combine_estimates(per_view)) {
    db::CalibratedLight light;
    light.light_index = estimate.light_index;
    light.placed = estimate.placed;
    light.reason = estimate.reason;
    if (estimate.placed) {
      light.light.direction = estimate.direction;
      light.light.position = estimate.position;
      light.sigma_degrees = estimate.sigma_degrees;
      sigmas.push_back(estimate.sigma_degrees);
      ++report.placed;
    }
    report.lights.push_back(light);
  }
  if (report.placed == 0) {
    throw core::BadInput("no light could be placed from the mirror-ball passes (first reason: " +
                         (report.lights.empty() ? "no light frames" : report.lights.front().reason) + ")");
  }
  const auto middle = sigmas.begin() + std::ptrdiff_t(sigmas.size() / 2);
  std::nth_element(sigmas.begin(), middle, sigmas.end());
  report.median_sigma_degrees = *middle;

  if (options.grey_ball) {
    const db::Scan scan = ball_pass(store, *options.grey_ball, db::ScanKind::kGreyBall, "grey ball");
    if (scan.stage_key != product.stage_key) {
      throw core::UsageError("scan '" + scan.name + "' stands on another stage than the mirror-ball passes");
    }
    product.input_scans.push_back(scan.id);
    report.gains_measured = measure_gains(store, scan, options, report.lights);
  } else {
    keep_gains(store, product, report);
  }
  product.parameters = json_text({{"mirror_radius_m", options.mirror_radius_m},
                                  {"grey_radius_m", options.grey_radius_m},
                                  {"grey_albedo", options.grey_albedo},
                                  {"gains_measured", report.gains_measured || report.gains_from}});
  report.calibration_id = store.add_calibration(product, report.lights);
  return report;
}

}  // namespace lightstage::cli
