#include "relight/environment_relighter.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <string>
#include <utility>

#include "core/error.h"
#include "core/sphere.h"
#include "core/stopwatch.h"
#include "model/picture_sum.h"
#include "relight/plan_execution.h"
#include "relight/relight.h"

namespace lightstage::relight {

namespace {

using core::Vec3;
using Clock = std::chrono::steady_clock;

void require_positive(double value, const char* what) {
  if (!(value > 0) || !std::isfinite(value))
    throw core::UsageError(std::string(what) + " must be above 0, not " + std::to_string(value));
}

std::size_t lit_pixels(const Environment& environment) {
  const core::Image& radiance = environment.radiance();
  std::size_t lit = 0;
  for (int y = 0; y < radiance.height(); ++y)
    for (int x = 0; x < radiance.width(); ++x) {
      const float* pixel = radiance.pixel(y, x);
      lit += pixel[0] > 0 || pixel[1] > 0 || pixel[2] > 0 ? 1 : 0;
    }
  return lit;
}

// A plan of as many pictures as the exhaustive answer has is no plan.
bool is_exhaustive(const Plan& plan, const Environment& environment) {
  return plan.pictures() > 0 && plan.pictures() >= lit_pixels(environment);
}

EnvironmentReport exhaustive(const model::LightInterpolator& method, const Environment& environment) {
  RelightReport relit = relight_lights(method, environment.lights(0));
  EnvironmentReport report;
  report.image = std::move(relit.image);
  report.directions_synthesised = relit.directions_synthesised;
  report.seconds_synthesising = relit.seconds;
  return report;
}

// For methods with linear weights.
EnvironmentReport captured_alone(const model::LightInterpolator& method, const Environment& environment) {
  // Weights vary over distances of the light spacing S. A box of side S/8 whose light stands at its mean direction errs first in the second moment,
  // (S/8)^2/12 an axis: with a second derivative of about 2/S^2 (that of the alias-free weights at their default sharpness) that is at most 0.3 % of one box's
  // light, and less over the map, where signs alternate.
  constexpr double kBoxesPerSpacing = 8;
  const core::OlatScan& scan = method.scan();
  const std::vector<Vec3> colours =
      method.captured_colours(environment.lights(core::median_spacing_radians(scan.directions()) / kBoxesPerSpacing));
  EnvironmentReport report;
  report.image = method.lit_by(colours);
  report.directions_captured =
      std::size_t(std::count_if(colours.begin(), colours.end(), [](Vec3 c) { return c != Vec3{}; }));
  return report;
}

EnvironmentReport report_of(core::Image image, Plan plan, const PlanExecution& execution) {
  EnvironmentReport report;
  report.image = std::move(image);
  report.directions_synthesised = execution.directions_synthesised();
  report.directions_captured = execution.directions_captured();
  report.seconds_synthesising = execution.seconds();
  report.dssim_estimate = plan.expected_error(ErrorMeasure::kDssim);
  report.rms_estimate = plan.expected_error(ErrorMeasure::kRelativeRms);
  report.plan = std::move(plan);
  return report;
}

}  // namespace

EnvironmentRelighter::EnvironmentRelighter(const model::LightInterpolator& method) : method_(method) {
  const bool is_linear = !method.linear_weights(core::Direction()).empty();
  if (!is_linear) captured_ = std::make_unique<const CapturedKnowledge>(method.scan());
}

Plan EnvironmentRelighter::plan(const Environment& environment, const ErrorGoal& goal) const {
  require_positive(goal.error, "an error");
  if (!captured_) return {};
  Plan plan = EnvironmentPlanner(*captured_, method_.scan(), environment).within(goal);
  if (is_exhaustive(plan, environment)) {
    plan = Plan();
    plan.synthesised = environment.lights(0);
    plan.saved.resize(plan.synthesised.size());
  }
  return plan;
}

EnvironmentReport EnvironmentRelighter::relight(const Environment& environment, const Goal& goal) const {
  const core::Stopwatch stopwatch;
  EnvironmentReport report;
  if (!captured_) {
    report = captured_alone(method_, environment);
  } else if (const auto* error = std::get_if<ErrorGoal>(&goal)) {
    report = within(environment, *error);
  } else if (const auto* time = std::get_if<TimeGoal>(&goal)) {
    report = within(environment, *time);
  } else {
    report = exhaustive(method_, environment);
  }
  report.directions_exhaustive = lit_pixels(environment);
  report.seconds = stopwatch.seconds();
  return report;
}

EnvironmentReport EnvironmentRelighter::within(const Environment& environment, const ErrorGoal& goal) const {
  require_positive(goal.error, "an error");
  const core::Stopwatch stopwatch;
  const EnvironmentPlanner planner(*captured_, method_.scan(), environment);
  const double seconds_planning = stopwatch.seconds();
  PlanExecution execution(*captured_, method_, planner.captured_colours());
  constexpr int kRounds = 3;  // one is mostly enough; a round more where errors turn out to be larger than expected
  ByPlace scale = kAlike;
  EnvironmentReport report;
  for (int round = 0; round < kRounds; ++round) {
    Plan plan = planner.within(goal, scale);
    if (is_exhaustive(plan, environment)) {
      report = exhaustive(method_, environment);
      report.directions_synthesised += execution.directions_synthesised();
      report.seconds_synthesising += execution.seconds();
      break;
    }
    core::Image image = execution.carry_out(plan);
    report = report_of(std::move(image), std::move(plan), execution);
    const bool met = report.plan.expected_error(goal.measure) <= goal.error;
    const ByPlace seen = execution.variance_scale();
    if (met || (seen.between_lights <= scale.between_lights && seen.in_holes <= scale.in_holes)) break;
    scale = seen;
  }
  report.seconds_planning = seconds_planning;
  return report;
}

EnvironmentReport EnvironmentRelighter::within(const Environment& environment, const TimeGoal& goal) const {
  require_positive(goal.seconds, "a time");
  const core::Stopwatch stopwatch;
  const EnvironmentPlanner planner(*captured_, method_.scan(), environment);
  const double seconds_planning = stopwatch.seconds();
  // To sum the captured pictures at the end takes a third of what planning took, at most.
  constexpr double kYear = 3e7;  // more would overflow the clock
  const double seconds_left = std::min(goal.seconds, kYear) - seconds_planning * 4 / 3;
  const Clock::time_point deadline =
      Clock::now() + std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(seconds_left));
  PlanExecution execution(*captured_, method_, planner.captured_colours());
  // The first picture takes longer than those after it; the second tells how long they take.
  for (const DistantLight& light : planner.at_most(2).synthesised) {
    if (Clock::now() < deadline) execution.picture(light.direction);
  }
  const double left = goal.seconds - seconds_planning / 3 - stopwatch.seconds();
  const double more = std::clamp(left / std::max(execution.last_seconds(), 1e-6), 0.0, double(lit_pixels(environment)));
  Plan plan = planner.at_most(execution.directions_synthesised() + std::size_t(more));
  core::Image image = execution.carry_out(plan, deadline);
  EnvironmentReport report = report_of(std::move(image), std::move(plan), execution);
  report.seconds_planning = seconds_planning;
  return report;
}

}  // namespace lightstage::relight
