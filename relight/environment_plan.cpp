#include "relight/environment_plan.h"

#include <algorithm>
#include <cmath>

#include "core/parallel.h"
#include "core/sphere.h"
#include "model/evaluation.h"
#include "model/metrics.h"
#include "model/picture_sum.h"
#include "relight/magnitude.h"
#include "relight/picture.h"
#include "relight/smooth_light.h"

namespace lightstage::relight {

namespace {

using core::Vec3;

// Errors within boxes of an eighth of the spacing are alike to a few percent; boxes are no finer where lights are very dense.
constexpr double kPatchesPerSpacing = 8;
constexpr double kFinestPatch = 0.012;  // radians, 0.7 degrees

// Errors of synthesised pictures stand at the edges of shadows and highlights, where the same square makes a larger DSSIM than in the differences of
// captured ones; and there are places where light comes from that are worse than their neighbours tell, most of all where there are no lights: at these
// values what was expected of the hole below simulated stages was what came out, within a fifth.
constexpr double kOfShadows = 1.5, kCaution = 1.4, kCautionInHoles = 1.8;

core::Image picture_of(const core::OlatScan& scan, std::span<const Vec3> colours) {
  model::PictureSum sum({scan.image_size().height, scan.image_size().width, 3});
  sum.add(scan, colours);
  return sum.result();
}

std::vector<LightDifferences::NearestLight> nearest_lights(std::span<const Patch> patches,
                                                           const LightDifferences& lights) {
  std::vector<LightDifferences::NearestLight> nearest(patches.size());
  core::parallel_for(patches.size(), 256, [&](std::size_t first, std::size_t last) {
    for (std::size_t p = first; p < last; ++p) nearest[p] = lights.nearest(patches[p].light.direction);
  });
  return nearest;
}

std::vector<std::size_t> neighbouring_order(std::span<const Patch> patches) {
  std::vector<core::Direction> directions;
  for (const Patch& patch : patches) directions.push_back(patch.light.direction);
  return core::neighbouring_order(directions);
}

// Of a picture from which the other differs by `difference` times a factor that makes the relative error small: the DSSIM between them over the square
// of that error. It grows with the square as long as errors are small beside the contrasts of the picture.
double dssim_per_square(const core::Image& picture, const core::Image& difference, const core::Image& mask) {
  constexpr double kSmall = 0.01;
  const double of_picture = masked_rms(picture, mask), of_difference = masked_rms(difference, mask);
  if (!(of_picture > 0 && of_difference > 0)) return 0;
  core::Image other = picture;
  const double factor = kSmall * of_picture / of_difference;
  for (std::size_t i = 0; i < other.values().size(); ++i)
    other.values()[i] = float(double(other.values()[i]) + factor * double(difference.values()[i]));
  const double exposure = std::exp2(-auto_exposure_stops(picture, mask));
  return model::dssim(model::judged(other, exposure, false), model::judged(picture, exposure, false), mask) /
         square(kSmall);
}

// Every second light along a path from neighbour to neighbour.
std::vector<std::size_t> every_second(const std::vector<core::Direction>& lights) {
  const std::vector<std::size_t> order = core::neighbouring_order(lights);
  std::vector<std::size_t> half;
  for (std::size_t i = 0; i < order.size(); i += 2) half.push_back(order[i]);
  return half;
}

// Directions drawn in proportion to what they weigh, one from each of `count` equal shares of the total, neighbours together (systematic sampling): the
// expected number of draws of i is count times weights[i] over the total. The draw starts at the same place every time.
std::vector<std::size_t> drawn(std::span<const double> weights, std::span<const std::size_t> order, std::size_t count) {
  double total = 0;
  for (const std::size_t i : order) total += weights[i];
  std::vector<std::size_t> chosen;
  if (!(total > 0)) return chosen;
  constexpr double kOffset = 0.381966011250105;
  double sum = 0;
  for (const std::size_t i : order) {
    sum += weights[i];
    while (chosen.size() < count && (double(chosen.size()) + kOffset) * total < sum * double(count))
      chosen.push_back(i);
  }
  return chosen;
}

void use(Plan& plan, const Cut& cut) {
  for (const Representative& light : cut.representatives) {
    plan.synthesised.push_back({light.direction, light.irradiance});
    plan.saved.push_back(light.saved);
  }
  plan.variance_left = cut.variance;
}

}  // namespace

double masked_rms(const core::Image& image, const core::Image& mask) {
  double squares = 0;
  std::size_t count = 0;
  for (int y = 0; y < image.height(); ++y)
    for (int x = 0; x < image.width(); ++x) {
      if (!mask.empty() && !(mask(y, x) > 0.5F)) continue;
      for (int c = 0; c < image.channels(); ++c) squares += square(double(image(y, x, c)));
      count += std::size_t(image.channels());
    }
  return count > 0 ? std::sqrt(squares / double(count)) : 0;
}

double Plan::expected_error(ErrorMeasure measure) const {
  if (!(picture_rms > 0)) return 0;
  if (measure == ErrorMeasure::kRelativeRms) return std::sqrt(variance_left.total() + smooth_variance) / picture_rms;
  constexpr double kWorst = 0.5;  // of pictures that have nothing in common
  return std::min(kWorst, (variance_left.weighed(dssim_per_square) + smooth_variance * smooth_dssim_per_square) /
                              square(picture_rms));
}

EnvironmentPlanner::EnvironmentPlanner(const CapturedKnowledge& captured, const core::OlatScan& scan,
                                       const Environment& environment)
    : captured_(captured),
      scan_(scan),
      patches_(environment.patches(std::max(captured.differences.spacing() / kPatchesPerSpacing, kFinestPatch))),
      order_(neighbouring_order(patches_)),
      nearest_(nearest_lights(patches_, captured.differences)),
      smooth_(smooth_light(patches_, nearest_, captured.differences, *captured.barycentric)),
      doubtful_(doubtful_light()),
      clusters_(doubtful_, captured.differences.spacing()) {
  std::vector<DistantLight> lights;
  for (const Patch& patch : patches_) {
    if (patch.light.irradiance != Vec3{}) lights.push_back(patch.light);
  }
  colours_ = captured.interpolation->captured_colours(lights);
  nothing_.picture_rms = root_mean_square(captured.differences.picture(colours_));
  if (!(nothing_.picture_rms > 0)) return;
  nothing_.smooth_variance = nothing_.unsampled_smooth_variance = expected_smooth_variance();
  const core::Image picture = picture_of(scan_, colours_);
  const auto per_square = [&](const core::Image& difference) {
    return dssim_per_square(picture, difference, scan_.mask());
  };
  nothing_.dssim_per_square =
      kOfShadows * ByPlace{per_square(difference_between_lights()), per_square(difference_in_holes())};
  nothing_.smooth_dssim_per_square = per_square(difference_of_smooth_light());
}

Plan EnvironmentPlanner::within(const ErrorGoal& goal, const ByPlace& scale) const {
  Plan plan = nothing_;
  if (!(plan.picture_rms > 0)) return plan;
  const bool dssim = goal.measure == ErrorMeasure::kDssim;
  const double allowed = (dssim ? goal.error : square(goal.error)) * square(plan.picture_rms);
  const ByPlace weights = scale * (dssim ? plan.dssim_per_square : kAlike);
  const double smooth_weight = dssim ? plan.smooth_dssim_per_square : 1;
  const double of_smooth = plan.smooth_variance * smooth_weight;
  // Sampling takes pictures too: only where the smooth part alone would nearly spoil the goal does it pay.
  const bool sampled = of_smooth > 0.8 * allowed;
  const double left = sampled ? 0.5 * allowed : allowed - of_smooth;
  const Cut cut = clusters_.within(left, weights);
  use(plan, cut);
  if (sampled) {
    const double samples = std::ceil(noise_of_one_sample(cut) * smooth_weight / (0.5 * allowed));
    sample(plan, cut, std::size_t(std::min(samples, double(patches_.size()))));
  }
  return plan;
}

Plan EnvironmentPlanner::at_most(std::size_t pictures) const {
  Plan plan = nothing_;
  if (!(plan.picture_rms > 0)) return plan;
  const Cut cut = clusters_.at_most(pictures, plan.dssim_per_square);
  use(plan, cut);
  const std::size_t left = pictures - plan.synthesised.size();
  if (double(left) * plan.smooth_variance > 2 * noise_of_one_sample(cut)) sample(plan, cut, left);
  return plan;
}

std::vector<DoubtfulLight> EnvironmentPlanner::doubtful_light() const {
  std::vector<DoubtfulLight> lights(patches_.size());
  for (std::size_t p = 0; p < patches_.size(); ++p) {
    const DistantLight& light = patches_[p].light;
    const bool between_lights = captured_.differences.between_lights(nearest_[p]);
    const double caution = between_lights ? kCaution : kCautionInHoles;
    lights[p] = {light.direction, light.irradiance - smooth_[p], caution * captured_.differences.expected(nearest_[p]),
                 between_lights};
  }
  return lights;
}

// The sum of the smooth part's differences, by samples of what display-encoding says of it; less the noise of the samples.
double EnvironmentPlanner::expected_smooth_variance() const {
  constexpr std::size_t kSamples = 128;
  std::vector<double> sizes;
  double total = 0;
  for (const Vec3 light : smooth_) total += sizes.emplace_back(magnitude(light));
  const std::vector<std::size_t> samples = drawn(sizes, order_, kSamples);
  if (samples.empty()) return 0;
  std::vector<std::vector<double>> differences(samples.size());
  core::parallel_for(samples.size(), 1, [&](std::size_t first, std::size_t last) {
    for (std::size_t s = first; s < last; ++s)
      differences[s] = captured_.differences.display_difference(
          captured_.interpolation->linear_weights(patches_[samples[s]].light.direction));
  });
  std::vector<double> sum(differences.front().size());
  double noise = 0;
  for (std::size_t s = 0; s < samples.size(); ++s) {
    const Vec3 colour = (total / sizes[samples[s]] / double(samples.size())) * smooth_[samples[s]];
    const double factors[3] = {colour.x, colour.y, colour.z};
    for (std::size_t i = 0; i < sum.size(); ++i) sum[i] += differences[s][i] *= factors[i % 3];
    noise += square(root_mean_square(differences[s]));
  }
  // The shipped network differs more, with nearly the same sign.
  constexpr double kOfNetworks = 1.6;
  return square(kOfNetworks) * std::max(0.0, square(root_mean_square(sum)) - noise);
}

// What pictures look like in which all that is doubtful about light between the captured lights is wrong: of every piece, the difference of the nearest light, with
// one sign or the other.
core::Image EnvironmentPlanner::difference_between_lights() const {
  std::vector<Vec3> colours(scan_.light_count());
  double sign = 1;
  for (const LightClusters::Doubt& doubt : clusters_.doubts()) {
    const std::size_t light = captured_.differences.nearest(doubt.direction).index;
    const double of_light = captured_.differences.of_light(light);
    if (!(of_light > 0)) continue;
    const double amount = sign * std::sqrt(doubt.variance.between_lights) / of_light;
    captured_.differences.add_difference(light, {amount, amount, amount}, colours);
    sign = -sign;
  }
  return picture_of(scan_, colours);
}

// The same of light in holes, where two ways to go on past the outermost lights differ as widely and as evenly as either does from a network's.
core::Image EnvironmentPlanner::difference_in_holes() const {
  std::vector<DistantLight> lights;
  std::vector<Vec3> nearest(scan_.light_count());
  for (std::size_t p = 0; p < patches_.size(); ++p) {
    if (doubtful_[p].between_lights || doubtful_[p].irradiance == Vec3{}) continue;
    lights.push_back({patches_[p].light.direction, doubtful_[p].irradiance});
    nearest[nearest_[p].index] = nearest[nearest_[p].index] + doubtful_[p].irradiance;
  }
  std::vector<Vec3> colours = captured_.interpolation->captured_colours(lights);
  for (std::size_t i = 0; i < colours.size(); ++i) colours[i] = colours[i] - nearest[i];
  return picture_of(scan_, colours);
}

// What a stage with half of the lights would say differently about the smooth part.
core::Image EnvironmentPlanner::difference_of_smooth_light() const {
  const std::vector<std::size_t> half = every_second(scan_.directions());
  const core::OlatScan thinned = scan_.with_lights(half);
  std::vector<DistantLight> lights;
  for (std::size_t p = 0; p < patches_.size(); ++p) {
    if (smooth_[p] != Vec3{}) lights.push_back({patches_[p].light.direction, smooth_[p]});
  }
  std::vector<Vec3> colours = captured_.interpolation->captured_colours(lights);
  const std::vector<Vec3> fewer = interpolation_of_captured(thinned)->captured_colours(lights);
  for (std::size_t i = 0; i < half.size(); ++i) colours[half[i]] = colours[half[i]] - fewer[i];
  return picture_of(scan_, colours);
}

// Light that no synthesised picture stands for.
Vec3 EnvironmentPlanner::remainder(const Cut& cut, std::size_t patch) const {
  return cut.represented[patch] ? smooth_[patch] : patches_[patch].light.irradiance;
}

// Samples are drawn in proportion to the light of the remainder times its error, and nowhere too seldom.
std::vector<double> EnvironmentPlanner::importance(const Cut& cut) const {
  double mean_error = 0;
  for (const DoubtfulLight& light : doubtful_) mean_error += light.error / double(doubtful_.size());
  std::vector<double> all;
  for (std::size_t p = 0; p < patches_.size(); ++p)
    all.push_back(magnitude(remainder(cut, p)) * (doubtful_[p].error + 0.1 * mean_error));
  return all;
}

// At most: the variance of an estimate of the remainder by one sample.
double EnvironmentPlanner::noise_of_one_sample(const Cut& cut) const {
  double sum = 0;
  for (const double v : importance(cut)) sum += v;
  return square(sum);
}

void EnvironmentPlanner::sample(Plan& plan, const Cut& cut, std::size_t count) const {
  if (count == 0) return;
  const std::vector<double> weights = importance(cut);
  double total = 0;
  for (const double v : weights) total += v;
  for (const std::size_t p : drawn(weights, order_, count))
    plan.remainder.push_back({patches_[p].light.direction, (total / weights[p] / double(count)) * remainder(cut, p)});
  plan.smooth_variance = std::min(plan.smooth_variance, square(total) / double(count));
}

}  // namespace lightstage::relight
