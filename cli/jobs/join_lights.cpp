#include "cli/jobs/join_lights.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "core/text.h"

namespace lightstage::cli {

namespace {

double degrees_between(const core::Direction& a, const core::Direction& b) {
  return core::degrees_from_radians(core::angle_radians(a, b));
}

double median(std::vector<double> values) {
  if (values.empty()) return std::numeric_limits<double>::quiet_NaN();
  const auto middle = values.begin() + std::ptrdiff_t(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

// By how much the views differ more than their standard errors say: the median over all pairs of views of a light, so that few wrong
// highlights do not count.
double disagreement(const std::vector<SeenLight>& lights) {
  constexpr double kMedianOfRayleigh = 0.8326;  // in units of the standard error of both coordinates together
  std::vector<double> ratios;
  for (const SeenLight& light : lights) {
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
std::string left_out(const PlacedLight& light, std::span<const SeenBall> views, bool compare) {
  std::string text;
  for (std::size_t v = 0; v < light.per_view.size(); ++v) {
    const calib::LightEstimate& estimate = light.per_view[v];
    std::string why = estimate.placed ? "" : estimate.reason;
    const double apart = estimate.placed ? degrees_between(estimate.direction, light.direction) : 0;
    if (compare && apart > std::max(1.0, 3 * estimate.sigma_degrees)) {
      why = "its highlight disagrees by " + core::number_text(apart, 2) + " degrees";
    }
    if (!why.empty()) text += (text.empty() ? "without " : "; ") + views[v].name() + ": " + why;
  }
  return text;
}

// Each light from its own views alone.
PlacedLight joined(SeenLight light, std::span<const SeenBall> views, double raise_sigmas) {
  std::vector<std::vector<calib::LightEstimate>> estimates;
  for (calib::LightEstimate& estimate : light.per_view) {
    if (estimate.placed) estimate.sigma_degrees *= raise_sigmas;
    estimates.push_back({estimate});
  }
  const calib::LightEstimate joint = calib::combine_estimates(estimates).front();
  PlacedLight placed;
  placed.index = light.index;
  placed.per_view = std::move(light.per_view);
  placed.used = joint.placed;
  placed.direction = joint.direction;
  placed.sigma_degrees = joint.sigma_degrees;
  placed.reason = joint.placed ? left_out(placed, views, true) : joint.reason;
  const bool unseen = std::none_of(placed.per_view.begin(), placed.per_view.end(),
                                   [](const auto& estimate) { return estimate.highlight.has_value(); });
  if (unseen && !light.when_unseen.empty() && placed.reason.starts_with("no highlight")) {
    placed.reason = light.when_unseen;
  }
  return placed;
}

// Each view has a camera of its own, since it may be a crop; views of one name show one ball.
void bundle(std::span<const SeenBall> views, const JoinOptions& options, LightsReport& report) {
  calib::BundleInput input;
  input.distances = options.distances;
  std::vector<std::string> balls;
  std::vector<std::size_t> ball_of_view;
  for (std::size_t v = 0; v < views.size(); ++v) {
    const auto known = std::find(balls.begin(), balls.end(), views[v].ball);
    ball_of_view.push_back(std::size_t(known - balls.begin()));
    if (known == balls.end()) balls.push_back(views[v].ball);
    input.cameras.push_back(views[v].model);
    input.outlines.push_back({v, ball_of_view[v], views[v].sphere});
  }
  std::map<int, PlacedLight*> by_index;
  for (PlacedLight& light : report.lights) {
    by_index[light.index] = &light;
    for (std::size_t v = 0; v < light.per_view.size(); ++v) {
      const calib::LightEstimate& estimate = light.per_view[v];
      if (!estimate.placed) continue;
      input.highlights.push_back({light.index, v, ball_of_view[v], estimate.highlight->position,
                                  estimate.highlight->sigma_px, views[v].name()});
    }
  }
  const calib::BundleResult result = calib::bundle_lights(input);
  report.rms_px = result.rms_px;
  for (std::size_t v = 0; v < report.balls.size(); ++v) report.balls[v] = result.balls[ball_of_view[v]];
  for (const calib::BundledLight& found : result.lights) {
    PlacedLight& light = *by_index.at(found.light_index);
    light.used = found.placed && found.sigma_degrees <= options.largest_sigma_degrees;
    if (!light.used) {
      light.reason = found.placed ? "its direction is not certain to " +
                                        core::number_text(options.largest_sigma_degrees, 2) + " degrees"
                                  : found.reason;
      continue;
    }
    light.position = found.position;
    light.covariance = found.covariance;
    light.direction = core::Direction::from_vector(found.position);
    light.sigma_degrees = found.sigma_degrees;
    light.sigma_m = found.sigma_m;
    const std::string hidden = left_out(light, views, false);
    light.reason = found.reason + (found.reason.empty() || hidden.empty() ? "" : "; ") + hidden;
  }
}

void summarise(LightsReport& report) {
  std::vector<double> degrees, metres;
  double to_joint = 0, between = 0;
  int views = 0, pairs = 0;
  for (const PlacedLight& light : report.lights) {
    if (!light.used) continue;
    ++report.used;
    degrees.push_back(light.sigma_degrees);
    if (light.position) metres.push_back(light.sigma_m);
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
  report.median_sigma_degrees = median(degrees);
  report.median_sigma_m = median(metres);
  report.mean_degrees_to_joint = views > 0 ? to_joint / views : std::numeric_limits<double>::quiet_NaN();
  report.mean_degrees_between = pairs > 0 ? between / pairs : std::numeric_limits<double>::quiet_NaN();
}

}  // namespace

LightsReport join_lights(std::span<const SeenBall> views, std::vector<SeenLight> lights, const JoinOptions& options) {
  LightsReport report;
  const double ratio = disagreement(lights);
  for (SeenLight& light : lights) report.lights.push_back(joined(std::move(light), views, ratio));
  for (const SeenBall& view : views) report.balls.push_back(view.sphere);
  if (options.metric && (views.size() > 1 || !options.distances.empty())) bundle(views, options, report);
  summarise(report);
  return report;
}

}  // namespace lightstage::cli
