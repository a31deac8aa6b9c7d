#include "model/evaluation.h"

#include <algorithm>
#include <chrono>
#include <cmath>

#include "core/display.h"
#include "core/error.h"
#include "core/image_file.h"
#include "core/interrupt.h"
#include "core/parallel.h"
#include "core/progress.h"
#include "core/sphere.h"
#include "model/metrics.h"

namespace lightstage::model {

namespace {

// The errors of one method so far.
struct Tally {
  MethodScore sums;  // rmse and h1 squared

  void add(const MethodScore& image) {
    ++sums.images;
    sums.rmse += image.rmse;
    sums.h1 += image.h1;
    sums.dssim += image.dssim;
    sums.flip += image.flip;
    sums.seconds_per_image += image.seconds_per_image;
  }

  MethodScore score() const {
    const double n = double(std::max<std::size_t>(1, sums.images));
    return {sums.name,      sums.images,   std::sqrt(sums.rmse / n),  std::sqrt(sums.h1 / n),
            sums.dssim / n, sums.flip / n, sums.seconds_per_image / n};
  }
};

std::vector<MethodScore> scores(const std::vector<Tally>& tallies) {
  std::vector<MethodScore> result;
  for (const Tally& tally : tallies) result.push_back(tally.score());
  return result;
}

// Compares what methods render with the truth, as one scan is judged.
class Judge {
 public:
  Judge(const core::OlatScan& scan, const EvaluationOptions& options)
      : scan_(scan), options_(options), exposure_(scan.exposure()) {}

  void compare(const LightInterpolator& method, const core::Direction& query, const core::Image& truth,
               Tally& tally) const {
    const auto start = std::chrono::steady_clock::now();
    const core::Image picture = method.render(query);
    const std::chrono::duration<double> elapsed = std::chrono::steady_clock::now() - start;
    core::require_finite(picture,
                         "the picture that " + std::string(method.name()) + " makes of scan '" + scan_.name() + "'");
    // A method may answer a grey scan in colour.
    const bool same_channels = picture.channels() == truth.channels();
    const core::Image is = same_channels ? picture : core::to_rgb(picture);
    const core::Image should = same_channels ? truth : core::to_rgb(truth);
    const core::Image is_shown = judged(is, exposure_, false), should_be_shown = judged(should, exposure_, false);
    MethodScore errors;
    if (options_.linear_values)
      measure(judged(is, exposure_, true), judged(should, exposure_, true), errors);
    else
      measure(is_shown, should_be_shown, errors);
    errors.flip = flip(is_shown, should_be_shown, scan_.mask());
    errors.seconds_per_image = elapsed.count();
    tally.add(errors);
  }

 private:
  void measure(core::ImageView is, core::ImageView should, MethodScore& errors) const {
    errors.rmse = mean_squared_error(is, should, scan_.mask());
    errors.h1 = squared_h1(is, should, scan_.mask());
    errors.dssim = dssim(is, should, scan_.mask());
  }

  const core::OlatScan& scan_;
  EvaluationOptions options_;
  double exposure_;
};

}  // namespace

core::Image judged(core::ImageView linear, double exposure, bool linear_values) {
  if (!(exposure > 0) || !std::isfinite(exposure))
    throw core::BadInput("pictures are judged at a positive exposure, not " + std::to_string(exposure));
  core::Image result(linear);
  core::parallel_for(result.values().size(), 1 << 14, [&](std::size_t first, std::size_t last) {
    for (float& v : result.values().subspan(first, last - first)) {
      const float clipped = static_cast<float>(std::clamp(double(v) / exposure, 0.0, 1.0));
      v = linear_values ? clipped : core::display_encode(clipped);
    }
  });
  return result;
}

std::vector<MethodScore> evaluate_held_out(const core::OlatScan& scan, std::span<const InterpolatorFactory> methods,
                                           int every, const EvaluationOptions& options) {
  if (every < 1) throw core::UsageError("every n-th light can be left out for n >= 1, not " + std::to_string(every));
  if (scan.light_count() < 2)
    throw core::UsageError("scan '" + scan.name() + "' has one light: none can be left out and predicted");
  const std::size_t step = std::size_t(every);
  // Held, so that methods fitted anew for every light need not encode the others anew.
  const core::OlatScan encoded = scan.display_encoded();
  const Judge judge(scan, options);
  std::vector<Tally> tallies(methods.size());
  core::Progress progress("evaluate", ((scan.light_count() - 1) / step + 1) * methods.size());
  for (std::size_t left_out = 0; left_out < scan.light_count(); left_out += step) {
    std::vector<std::size_t> others;
    for (std::size_t i = 0; i < scan.light_count(); ++i)
      if (i != left_out) others.push_back(i);
    const core::OlatScan rest = scan.with_lights(others);
    const auto truth = scan.image(left_out);
    for (std::size_t m = 0; m < methods.size(); ++m) {
      core::throw_if_interrupted();
      const std::unique_ptr<LightInterpolator> method = methods[m](rest);
      tallies[m].sums.name = method->name();
      judge.compare(*method, scan.directions()[left_out], *truth, tallies[m]);
      progress.advance();
    }
  }
  return scores(tallies);
}

std::vector<MethodScore> evaluate_against_truth(const core::OlatScan& scan,
                                                std::span<const InterpolatorFactory> methods,
                                                std::span<const core::Direction> directions,
                                                const std::function<core::Image(std::size_t)>& truth,
                                                const EvaluationOptions& options) {
  const Judge judge(scan, options);
  std::vector<std::unique_ptr<LightInterpolator>> fitted;
  std::vector<Tally> tallies(methods.size());
  for (std::size_t m = 0; m < methods.size(); ++m) {
    fitted.push_back(methods[m](scan));
    tallies[m].sums.name = fitted[m]->name();
  }
  core::Progress progress("evaluate", directions.size() * methods.size());
  for (std::size_t i = 0; i < directions.size(); ++i) {
    const core::Image right = truth(i);
    for (std::size_t m = 0; m < fitted.size(); ++m) {
      core::throw_if_interrupted();
      judge.compare(*fitted[m], directions[i], right, tallies[m]);
      progress.advance();
    }
  }
  return scores(tallies);
}

std::vector<core::Direction> off_grid_directions(std::span<const core::Direction> lights, std::size_t count,
                                                 std::uint64_t seed) {
  constexpr std::size_t kBatch = 1024;
  constexpr std::uint64_t kMaxBatches = 1000;
  if (lights.empty()) throw core::BadInput("directions near lights need at least one light");
  const double reach = 2 * core::median_spacing_radians(lights);
  std::vector<core::Direction> chosen;
  // Each batch has its own seed; a batch is a pure function of it.
  for (std::uint64_t batch = 0; chosen.size() < count; ++batch) {
    if (batch == kMaxBatches)
      throw core::BadInput("the lights stand too close together to find directions between them by chance");
    for (const core::Direction& d : core::random_directions(kBatch, seed + batch * 0x9e3779b97f4a7c15u)) {
      if (chosen.size() == count) break;
      const std::size_t nearest = core::nearest_indices(lights, d, 1).front();
      if (core::angle_radians(lights[nearest], d) <= reach) chosen.push_back(d);
    }
  }
  return chosen;
}

}  // namespace lightstage::model
