#include "cli/jobs/calibrate.h"

#include <algorithm>
#include <memory>

#include <nlohmann/json.hpp>

#include "calib/light_gain.h"
#include "cli/jobs/ball_pass.h"
#include "cli/jobs/stage_cameras.h"
#include "cli/jobs/stored_json.h"
#include "cli/options.h"
#include "core/error.h"
#include "core/interrupt.h"
#include "core/parallel.h"
#include "core/progress.h"

namespace lightstage::cli {

namespace {

// Of the lights' distances in a stage file, where nothing better is known.
constexpr double kDrawnDistanceShare = 0.01;

// The mirror-ball passes by camera, and the lights in them.
struct MirrorPasses {
  std::vector<SeenBall> balls;
  std::vector<BallView> views;  // as `balls`
  std::vector<SeenLight> lights;
};

// Where several frames show a light (exposures of several lengths), the one that tells its direction best.
calib::LightEstimate best_estimate(const db::Store& store, const BallView& view, int light, double distance_m) {
  calib::LightEstimate best;
  best.light_index = light;
  best.reason = "not lit in this pass";
  for (std::size_t i = 0; i < view.light_frames.size(); ++i) {
    if (view.light_index[i] != light) continue;
    calib::LightEstimate estimate =
        calib::estimate_light(picture_of_light(store, view, i), view.camera, view.ball, distance_m);
    const bool better = estimate.placed && (!best.placed || estimate.sigma_degrees < best.sigma_degrees);
    if (better || !best.placed) best = std::move(estimate);
  }
  return best;
}

// What the drawing says of a light that no ball shows.
std::string when_unseen(const std::vector<BallView>& views, core::Vec3 drawn) {
  const bool due = std::any_of(views.begin(), views.end(), [&](const BallView& view) {
    const std::optional<core::Pixel> p = calib::predict_highlight(view.camera, view.ball, drawn);
    return p && p->x > 0 && p->y > 0 && p->x < view.camera.width - 1 && p->y < view.camera.height - 1;
  });
  return due ? "dead: no highlight on the ball, which would show it where it is drawn"
             : "hidden: no highlight on the ball, behind which it is drawn";
}

MirrorPasses look_at_passes(const db::Store& store, const CalibrateOptions& options, db::NewProduct& product,
                            JoinOptions& join) {
  MirrorPasses passes;
  std::vector<core::Vec3> drawn;
  for (const std::string& name : options.mirror_balls) {
    const db::Scan scan = ball_pass(store, name, db::ScanKind::kMirrorBall, "mirror ball");
    if (!product.stage_key.empty() && scan.stage_key != product.stage_key) {
      throw core::UsageError("scan '" + name + "' stands on another stage than '" + options.mirror_balls.front() + "'");
    }
    if (std::find(product.input_scans.begin(), product.input_scans.end(), scan.id) != product.input_scans.end()) {
      throw core::UsageError("scan '" + name + "' is named twice");
    }
    product.stage_key = scan.stage_key;
    product.input_scans.push_back(scan.id);
    const capture::Stage stage = calibrated_provenance(store, scan).stage;
    drawn = stage.light_positions;
    for (const capture::StageCamera& camera : stage.cameras) {
      passes.views.push_back(view_ball(store, scan, camera, options.mirror_radius_m));
      const BallView& view = passes.views.back();
      passes.balls.push_back({scan.name, camera.name, view.camera, view.ball});
    }
  }
  join.metric = true;
  core::Progress progress("highlights", drawn.size() * passes.views.size());
  for (std::size_t i = 0; i < drawn.size(); ++i) {
    const double distance = norm(drawn[i]);
    join.distances[int(i)] = {distance, kDrawnDistanceShare * distance};
    passes.lights.push_back(
        {int(i), std::vector<calib::LightEstimate>(passes.views.size()), when_unseen(passes.views, drawn[i])});
  }
  core::parallel_for(drawn.size(), 1, [&](std::size_t first, std::size_t last) {
    for (std::size_t i = first; i < last; ++i) {
      for (std::size_t v = 0; v < passes.views.size(); ++v) {
        core::throw_if_interrupted();
        passes.lights[i].per_view[v] = best_estimate(store, passes.views[v], int(i), norm(drawn[i]));
        progress.advance();
      }
    }
  });
  return passes;
}

double median(std::vector<double> values) {
  const auto middle = values.begin() + std::ptrdiff_t(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

void add_reason(std::string& reasons, const std::string& reason) {
  reasons += (reasons.empty() ? "" : "; ") + reason;
}

// Whether any light's gain could be measured; if none could, all stay 1.
bool measure_gains(const db::Store& store, const db::Scan& scan, const CalibrateOptions& options,
                   CalibrateReport& report) {
  const CaptureProvenance provenance = calibrated_provenance(store, scan);
  const BallView view = view_ball(store, scan, provenance.stage.cameras.front(), options.grey_radius_m);
  core::Progress progress("light gains", view.light_frames.size());
  std::map<int, std::string> problems;
  for (std::size_t i = 0; i < view.light_frames.size(); ++i) {
    core::throw_if_interrupted();
    progress.advance();
    const auto light = std::find_if(report.lights.begin(), report.lights.end(),
                                    [&](const db::CalibratedLight& l) { return l.light_index == view.light_index[i]; });
    if (light == report.lights.end() || !light->placed) continue;
    const calib::BallPicture picture = picture_of_light(store, view, i);
    const PlacedLight& placed = report.joined.lights[std::size_t(light - report.lights.begin())];
    const calib::GainEstimate estimate =
        calib::estimate_gain(picture.image, view.camera, view.ball, options.grey_albedo, *light->light.position,
                             picture.saturation, placed.covariance);
    if (estimate.measured) {
      light->light.gain = estimate.gain;
      report.gain_sigma[light->light_index] = estimate.relative_sigma;
    } else {
      problems[light->light_index] = estimate.reason;
    }
  }
  // A light that the grey ball does not show to the camera (behind it) gets the typical gain.
  std::array<std::vector<double>, 3> measured;
  for (const db::CalibratedLight& light : report.lights) {
    if (!report.gain_sigma.contains(light.light_index)) continue;
    for (std::size_t c = 0; c < 3; ++c) measured[c].push_back(light.light.gain[c]);
  }
  if (measured[0].empty()) return false;
  const std::array<double, 3> typical{median(measured[0]), median(measured[1]), median(measured[2])};
  for (db::CalibratedLight& light : report.lights) {
    if (!light.placed || report.gain_sigma.contains(light.light_index)) continue;
    light.light.gain = typical;
    const auto problem = problems.find(light.light_index);
    add_reason(light.reason, "gain taken as the median of the others: " +
                                 (problem == problems.end() ? "not lit in the grey ball's pass" : problem->second));
  }
  return true;
}

// The gains of the stage's newest calibration, if they were measured, for lights that are placed in both.
// `albedo` becomes that of the grey ball they were measured on.
void keep_gains(const db::Store& store, db::NewProduct& product, CalibrateReport& report, double& albedo) {
  const std::optional<db::Product> before = store.newest_calibration(product.stage_key);
  if (!before) return;
  const nlohmann::json parameters = nlohmann::json::parse(before->parameters, nullptr, false);
  const auto measured = parameters.is_object() ? parameters.find("gains_measured") : parameters.end();
  if (!parameters.is_object() || measured == parameters.end() || *measured != true) return;
  std::map<int, double> sigmas;
  reading_json("calibration " + std::to_string(before->id), [&] {
    sigmas = parameters.value("gain_sigma", sigmas);
    albedo = parameters.value("grey_albedo", albedo);
  });
  const std::vector<db::CalibratedLight> earlier = store.calibrated_lights(before->id);
  for (db::CalibratedLight& light : report.lights) {
    const auto same = std::find_if(earlier.begin(), earlier.end(), [&](const db::CalibratedLight& e) {
      return e.placed && e.light_index == light.light_index;
    });
    if (!light.placed || same == earlier.end()) continue;
    light.light.gain = same->light.gain;
    const auto sigma = sigmas.find(light.light_index);
    if (sigma != sigmas.end()) report.gain_sigma.insert(*sigma);
  }
  product.input_products.push_back(before->id);
  report.gains_from = before->created_utc;
}

}  // namespace

CalibrateReport calibrate(db::Store& store, const CalibrateOptions& options) {
  db::NewProduct product;
  product.kind = "calibration";
  product.name = options.name;
  JoinOptions join;
  const auto passes = std::make_shared<MirrorPasses>(look_at_passes(store, options, product, join));
  CalibrateReport report;
  report.joined = join_lights(passes->balls, passes->lights, join);
  for (const PlacedLight& placed : report.joined.lights) {
    db::CalibratedLight light;
    light.light_index = placed.index;
    light.placed = placed.used;
    light.reason = placed.reason;
    if (placed.used) {
      light.light.direction = placed.direction;
      light.light.position = placed.position;
      light.sigma_degrees = placed.sigma_degrees;
    }
    report.lights.push_back(light);
    report.sources.names.push_back("light_" + std::to_string(placed.index));
  }
  if (report.joined.used == 0) {
    throw core::BadInput("no light could be placed from the mirror-ball passes (first reason: " +
                         (report.lights.empty() ? "no light frames" : report.lights.front().reason) + ")");
  }
  report.sources.views = passes->balls;
  report.sources.picture = [passes, &store](std::size_t v, std::size_t light) {
    const BallView& view = passes->views[v];
    const auto frame = std::find(view.light_index.begin(), view.light_index.end(), int(light));
    if (frame == view.light_index.end()) return core::Image();
    calib::BallPicture picture = picture_of_light(store, view, std::size_t(frame - view.light_index.begin()));
    if (picture.saturation > 0) {
      for (float& value : picture.image.values()) value = float(value / picture.saturation);
    }
    return std::move(picture.image);
  };

  double grey_albedo = options.grey_albedo;
  if (options.grey_ball) {
    const db::Scan scan = ball_pass(store, *options.grey_ball, db::ScanKind::kGreyBall, "grey ball");
    if (scan.stage_key != product.stage_key) {
      throw core::UsageError("scan '" + scan.name + "' stands on another stage than the mirror-ball passes");
    }
    product.input_scans.push_back(scan.id);
    report.gains_measured = measure_gains(store, scan, options, report);
  } else {
    keep_gains(store, product, report, grey_albedo);
  }
  product.parameters = json_text({{"mirror_radius_m", options.mirror_radius_m},
                                  {"grey_radius_m", options.grey_radius_m},
                                  {"grey_albedo", grey_albedo},
                                  {"gains_measured", report.gains_measured || report.gains_from},
                                  {"gain_sigma", report.gain_sigma},
                                  {"median_sigma_m", report.joined.median_sigma_m}});
  report.calibration_id = store.add_calibration(product, report.lights);
  return report;
}

}  // namespace lightstage::cli
