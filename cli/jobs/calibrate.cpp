#include "cli/jobs/calibrate.h"

#include <algorithm>

#include <nlohmann/json.hpp>

#include "calib/light_gain.h"
#include "calib/mirror_ball.h"
#include "calib/sphere_fit.h"
#include "cli/jobs/provenance.h"
#include "cli/options.h"
#include "core/error.h"
#include "core/interrupt.h"
#include "core/progress.h"
#include "db/scan_loader.h"

namespace lightstage::cli {

namespace {

db::Scan ball_pass(const db::Store& store, const std::string& name, db::ScanKind kind, const char* what) {
  db::Scan scan = store.scan(name);
  if (scan.kind != kind) {
    throw core::UsageError("scan '" + name + "' is " + std::string(db::to_string(scan.kind)) + ", not a pass of a " +
                           what);
  }
  return scan;
}

// One camera's frames of a ball pass, and where the ball is in them.
struct BallView {
  core::CameraModel camera;
  core::Image dark;
  calib::Sphere ball;
  std::vector<db::Frame> light_frames;
  std::vector<int> light_index;  // per light frame
};

// A clipped edge lies outside the true one: such a frame would give too large a ball.
void require_not_overexposed(core::ImageView full_on, double saturation, const std::string& where) {
  if (saturation <= 0) return;
  std::size_t bright = 0, clipped = 0;
  const core::Image luminance = core::to_luminance(full_on);
  for (const float value : luminance.values()) {
    if (value > 0.1 * saturation) ++bright;
    if (value > 0.98 * saturation) ++clipped;
  }
  if (clipped * 2 > bright) {
    throw core::BadInput(where +
                         ": overexposed, so that the ball's outline cannot be told; shorten that step's exposure, or "
                         "take larger pictures");
  }
}

BallView view_ball(const db::Store& store, const db::Scan& scan, const capture::StageCamera& camera, double radius_m) {
  BallView view;
  view.camera = camera.model;
  view.dark = db::dark_level(store, scan, camera.name);
  const std::string where = "scan '" + scan.name + "', camera '" + camera.name + "', full-on frame";
  std::optional<core::Image> full_on;
  for (const db::Frame& frame : store.frames(scan.id, camera.name)) {
    const db::Step& step = scan.steps.at(std::size_t(frame.step_index));
    if (step.kind == db::StepKind::kFullOn) {
      full_on = db::load_frame(store, frame, view.dark);
      require_not_overexposed(*full_on, frame.saturation, where);
    }
    if (step.kind == db::StepKind::kLight) {
      view.light_frames.push_back(frame);
      view.light_index.push_back(*step.light_index);
    }
  }
  if (!full_on) {
    throw core::BadInput(where + ": missing; the ball is found in it, capture the pass with a full_on step");
  }
  try {
    view.ball = calib::locate_sphere(*full_on, camera.model, radius_m);
  } catch (const core::BadInput& error) {
    throw core::BadInput(where + ": " + error.what());
  }
  return view;
}

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
  const CaptureProvenance provenance = capture_provenance(scan);
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
    const CaptureProvenance provenance = capture_provenance(scan);
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
  }
  product.parameters = json_text({{"mirror_radius_m", options.mirror_radius_m},
                                  {"grey_radius_m", options.grey_radius_m},
                                  {"grey_albedo", options.grey_albedo},
                                  {"gains_measured", report.gains_measured}});
  report.calibration_id = store.add_calibration(product, report.lights);
  return report;
}

}  // namespace lightstage::cli
