#include "relight/plan_execution.h"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "core/interrupt.h"
#include "core/sphere.h"
#include "core/stopwatch.h"
#include "relight/magnitude.h"

namespace lightstage::relight {

namespace {

using core::Vec3;
using Clock = std::chrono::steady_clock;

bool late(const PlanExecution::Deadline& deadline) {
  return deadline && Clock::now() >= *deadline;
}

model::PictureSum empty_sum(const core::OlatScan& scan) {
  return model::PictureSum({scan.image_size().height, scan.image_size().width, 3});
}

}  // namespace

PlanExecution::PlanExecution(const CapturedKnowledge& captured, const model::LightInterpolator& method,
                             std::span<const Vec3> captured_colours)
    : captured_(captured), method_(method), colours_(captured_colours.begin(), captured_colours.end()) {}

core::Image PlanExecution::carry_out(Plan& plan, const Deadline& deadline) {
  compared_ = observed_ = expected_ = ByPlace();
  std::vector<Vec3> colours = colours_;
  model::PictureSum sum = empty_sum(method_.scan());
  std::vector<std::size_t> order(plan.synthesised.size());
  std::iota(order.begin(), order.end(), std::size_t(0));
  if (!deadline) {  // neighbours share what the method has prepared; with a deadline, what saves most comes first
    std::vector<core::Direction> directions;
    for (const DistantLight& light : plan.synthesised) directions.push_back(light.direction);
    order = core::neighbouring_order(directions);
  }
  std::size_t done = 0;
  for (; done < order.size() && !late(deadline); ++done) add(plan.synthesised[order[done]], sum, colours);
  for (std::size_t i = done; i < order.size(); ++i) plan.variance_left = plan.variance_left + plan.saved[i];
  plan.synthesised.resize(done);
  plan.saved.resize(done);
  plan.variance_left = variance_scale() * plan.variance_left;
  if (!plan.remainder.empty()) add_remainder(plan, sum, deadline);
  sum.add(method_.scan(), colours);
  captured_used_ = std::size_t(std::count_if(colours.begin(), colours.end(), [](Vec3 c) { return c != Vec3{}; }));
  return sum.result();
}

core::Image PlanExecution::picture(const core::Direction& direction) {
  const std::array<double, 3> key{direction.x(), direction.y(), direction.z()};
  if (const auto found = kept_.find(key); found != kept_.end()) return found->second;
  core::throw_if_interrupted();
  const core::Stopwatch stopwatch;
  core::Image image = method_.render(direction);
  if (image.channels() != 3) image = core::to_rgb(image);
  last_seconds_ = stopwatch.seconds();
  seconds_ += last_seconds_;
  ++rendered_;
  constexpr std::size_t kMostBytes = std::size_t(1) << 29;
  const std::size_t bytes = image.values().size_bytes();
  if (kept_bytes_ + bytes <= kMostBytes) {
    kept_bytes_ += bytes;
    kept_.emplace(key, image);
  }
  return image;
}

ByPlace PlanExecution::variance_scale() const {
  ByPlace scale = kAlike;
  for (const auto place : {&ByPlace::between_lights, &ByPlace::in_holes}) {
    if (!(expected_.*place > 0)) continue;
    const double prior = 4 * expected_.*place / compared_.*place;
    scale.*place = std::max(1.0, (observed_.*place + prior) / (expected_.*place + prior));
  }
  return scale;
}

// Adds the difference D of one light, times its irradiance, and returns the mean square of that at the pixels that are looked at.
double PlanExecution::add(const DistantLight& light, model::PictureSum& sum, std::vector<Vec3>& colours) {
  const core::Image image = picture(light.direction);
  sum.add(image, light.irradiance);
  const std::vector<double> weights = captured_.interpolation->linear_weights(light.direction);
  for (std::size_t i = 0; i < weights.size(); ++i) colours[i] = colours[i] - weights[i] * light.irradiance;
  const double size = magnitude(light.irradiance);
  const double observed = square(size * root_mean_square(captured_.differences.observed_difference(image, weights)));
  const LightDifferences::NearestLight nearest = captured_.differences.nearest(light.direction);
  const auto place = captured_.differences.between_lights(nearest) ? &ByPlace::between_lights : &ByPlace::in_holes;
  observed_.*place += observed;
  expected_.*place += square(size * captured_.differences.expected(nearest));
  compared_.*place += 1;
  return observed;
}

void PlanExecution::add_remainder(Plan& plan, model::PictureSum& sum, const Deadline& deadline) {
  const core::OlatScan& scan = method_.scan();
  model::PictureSum estimate = empty_sum(scan);
  std::vector<Vec3> colours(scan.light_count());
  double noise = 0;
  for (const DistantLight& light : plan.remainder) {
    if (late(deadline)) {  // some of the samples say nothing of the whole
      plan.remainder.clear();
      plan.smooth_variance = plan.unsampled_smooth_variance;
      return;
    }
    noise += add(light, estimate, colours);
  }
  estimate.add(scan, colours);
  const core::Image difference = estimate.result();
  const double squared = square(masked_rms(difference, scan.mask()));
  const double share = squared > noise ? 1 - noise / squared : 0;
  sum.add(difference, {share, share, share});
  plan.smooth_variance = std::min(noise, std::max(plan.smooth_variance, squared - noise));
}

}  // namespace lightstage::relight
