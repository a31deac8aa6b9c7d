#include "cli/jobs/calibrate_pictures.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "calib/light_bundle.h"
#include "core/interrupt.h"
#include "core/parallel.h"
#include "core/progress.h"
#include "core/stopwatch.h"
#include "core/text.h"

namespace lightstage::cli {

namespace {

// Circles drawn by hand on small balls are off by a few degrees; a stage's drawing, which would be better, there is none.
constexpr double kLargestSigmaDegrees = 5;

double degrees_between(const core::Direction& a, const core::Direction& b) {
  return core::degrees_from_radians(core::angle_radians(a, b));
}

double median(std::vector<double> values) {
  if (values.empty()) return std::numeric_limits<double>::quiet_NaN();
  const auto middle = values.begin() + std::ptrdiff_t(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

// The bright end of a picture, whatever few pixels are hot: its 99.9th percentile.
double bright_end(core::ImageView picture) {
  const core::Image luminance = core::to_luminance(picture);
  return core::quantile(luminance.values(), 0.999);
}

// By how much the views differ more than their standard errors say: the median over all pairs of views of a light, so that few wrong
// highlights do not count.
double disagreement(const std::vector<PlacedLight>& lights) {
  constexpr double kMedianOfRayleigh = 0.8326;  // in units of the standard error of both coordinates together
  std::vector<double> ratios;
  for (const PlacedLight& light : lights) {
    for (std::size_t a = 0; a < light.per_view.size(); ++a) {
      for (std::size_t b = 0; b < a; ++b) {
        const calib::LightEstimate &one = light.per_view[a], &other = light.per_view[b];
        if (!one.placed || !other.placed) continue;
        const double expected = std::hypot(one.sigma_degrees, other.sigma_degrees);
        ratios.push_back(degrees_between(one.direction, other.direction) / std::max(1e-9, expected));
      }
    }
  }
  return ratios.empty() ? 1 : std::max(1.0, median(ratios) / kMedianOfRayleigh);
}

// Which views the joint direction leaves out: those that show no highlight and, with `compare`, those that disagree.
std::string left_out(const PlacedLight& light, const BallPictures& pictures, bool compare) {
  std::string text;
  for (std::size_t v = 0; v < light.per_view.size(); ++v) {
    const calib::LightEstimate& estimate = light.per_view[v];
    std::string why = estimate.placed ? "" : estimate.reason;
    const double apart = estimate.placed ? degrees_between(estimate.direction, light.direction) : 0;
    if (compare && apart > std::max(1.0, 3 * estimate.sigma_degrees)) {
      why = "its highlight disagrees by " + core::number_text(apart, 2) + " degrees";
    }
    if (!why.empty()) text += (text.empty() ? "without " : "; ") + pictures.views[v].ball + ": " + why;
  }
  return text;
}

// Each view has a camera of its own, since it may be a crop; views of one name show one ball.
void bundle(const BallPictures& pictures, PicturesReport& report) {
  calib::BundleInput input;
  std::vector<std::string> balls;
  std::vector<std::size_t> ball_of_view;
  for (std::size_t v = 0; v < pictures.views.size(); ++v) {
    const BallInPictures& view = pictures.views[v];
    const auto known = std::find(balls.begin(), balls.end(), view.ball);
    ball_of_view.push_back(std::size_t(known - balls.begin()));
    if (known == balls.end()) balls.push_back(view.ball);
    input.cameras.push_back(view.model);
    input.outlines.push_back({v, ball_of_view[v], view.sphere});
  }
  for (const PlacedLight& light : report.lights) {
    for (std::size_t v = 0; v < light.per_view.size(); ++v) {
      const calib::LightEstimate& estimate = light.per_view[v];
      if (!estimate.placed) continue;
      input.highlights.push_back(
          {light.index, v, ball_of_view[v], estimate.highlight->position, estimate.highlight->sigma_px});
    }
  }
  if (pictures.stage_radius_m) {
    input.stage_radius = calib::StageRadius{*pictures.stage_radius_m, pictures.stage_radius_sigma_m};
  }
  const calib::BundleResult result = calib::bundle_lights(input);
  report.rms_px = result.rms_px;
  for (std::size_t v = 0; v < report.balls.size(); ++v) report.balls[v] = result.balls[ball_of_view[v]];
  for (const calib::BundledLight& found : result.lights) {
    PlacedLight& light = report.lights[std::size_t(found.light_index)];
    light.used = found.placed && found.sigma_degrees <= kLargestSigmaDegrees;
    if (!light.used) {
      light.reason = found.placed ? "its direction is not certain to 5 degrees" : found.reason;
      continue;
    }
    light.position = found.position;
    light.direction = core::Direction::from_vector(found.position);
    light.sigma_degrees = found.sigma_degrees;
    light.sigma_m = found.sigma_m;
    const std::string hidden = left_out(light, pictures, false);
    light.reason = found.reason + (found.reason.empty() || hidden.empty() ? "" : "; ") + hidden;
  }
}

}  // namespace

PicturesReport calibrate_pictures(const BallPictures& pictures) {
  constexpr double kDeadShare = 0.01;
  const core::Stopwatch watch;
  PicturesReport report;
  report.lights.resize(pictures.names.size());
  std::vector<double> brightness(pictures.names.size(), 0);
  core::Progress progress("highlights", pictures.names.size());
  core::parallel_for(pictures.names.size(), 1, [&](std::size_t first, std::size_t last) {
    for (std::size_t i = first; i < last; ++i) {
      core::throw_if_interrupted();
      PlacedLight& light = report.lights[i];
      light.index = static_cast<int>(i);
      const BallInPictures* loaded = nullptr;
      calib::BallPicture picture{light.index, {}, pictures.saturation};
      for (const BallInPictures& view : pictures.views) {
        if (loaded == nullptr || loaded->folder != view.folder) {
          picture.image = load_picture(pictures, view, i);
          brightness[i] = std::max(brightness[i], bright_end(picture.image));
          loaded = &view;
        }
        light.per_view.push_back(
            calib::estimate_light(picture, view.model, view.sphere, view.light_distance, kLargestSigmaDegrees));
      }
      progress.advance();
    }
  });

  const double ratio = disagreement(report.lights);
  const double usual = median(brightness);
  for (PlacedLight& light : report.lights) {
    std::vector<std::vector<calib::LightEstimate>> views;
    for (calib::LightEstimate& estimate : light.per_view) {
      if (estimate.placed) estimate.sigma_degrees *= ratio;
      views.push_back({estimate});
    }
    const calib::LightEstimate joint = calib::combine_estimates(views).front();
    light.used = joint.placed;
    light.direction = joint.direction;
    light.sigma_degrees = joint.sigma_degrees;
    light.reason = joint.reason;
    if (joint.placed) {
      light.reason = left_out(light, pictures, true);
      continue;
    }
    const bool no_highlight = std::none_of(light.per_view.begin(), light.per_view.end(),
                                           [](const auto& e) { return e.highlight.has_value(); });
    if (no_highlight && light.reason.starts_with("no highlight")) {
      light.reason = brightness[std::size_t(light.index)] <= kDeadShare * usual
                         ? "dead: its picture is dark"
                         : "hidden: its picture is lit, but " + light.reason;
    }
  }

  for (const BallInPictures& view : pictures.views) report.balls.push_back(view.sphere);
  if (pictures.metric && pictures.views.size() > 1) bundle(pictures, report);

  std::vector<double> sigmas;
  double to_joint = 0, between = 0;
  int views = 0, pairs = 0;
  for (PlacedLight& light : report.lights) {
    if (!light.used) continue;
    ++report.used;
    sigmas.push_back(light.sigma_degrees);
    std::vector<core::Direction> seen;
    for (const calib::LightEstimate& estimate : light.per_view) {
      if (estimate.placed) seen.push_back(estimate.direction);
    }
    for (std::size_t a = 0; seen.size() > 1 && a < seen.size(); ++a) {
      to_joint += degrees_between(seen[a], light.direction);
      ++views;
      for (std::size_t b = 0; b < a; ++b, ++pairs) between += degrees_between(seen[a], seen[b]);
    }
  }
  report.median_sigma_degrees = median(sigmas);
  report.mean_degrees_to_joint = views > 0 ? to_joint / views : std::numeric_limits<double>::quiet_NaN();
  report.mean_degrees_between = pairs > 0 ? between / pairs : std::numeric_limits<double>::quiet_NaN();
  report.seconds = watch.seconds();
  return report;
}

}  // namespace lightstage::cli
