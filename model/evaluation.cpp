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
#include "model/peak_memory.h"

namespace lightstage::model {

namespace {

constexpr double kBinDegrees = 1.5, kLastBinDegrees = 15;

// The mean of what `of` gives for each; 0 for none.
template <class Of>
double mean(std::span<const ImageScore> images, const Of& of) {
  double sum = 0;
  for (const ImageScore& image : images) sum += of(image);
  return images.empty() ? 0 : sum / double(images.size());
}

double mean_of(std::span<const ImageScore> images, double ImageScore::*error) {
  return mean(images, [error](const ImageScore& image) { return image.*error; });
}

std::optional<double> mean_of(std::span<const ImageScore> images, std::optional<double> ImageScore::*error) {
  if (images.empty() || !(images.front().*error)) return std::nullopt;
  return mean(images, [error](const ImageScore& image) { return (image.*error).value(); });
}

std::vector<AngleBin> by_angle(const std::vector<ImageScore>& images) {
  std::vector<AngleBin> bins;
  for (int i = 0; i * kBinDegrees < kLastBinDegrees; ++i)
    bins.push_back({.from_deg = i * kBinDegrees, .to_deg = (i + 1) * kBinDegrees});
  bins.push_back({.from_deg = kLastBinDegrees, .to_deg = 180});
  std::vector<std::vector<ImageScore>> sorted(bins.size());
  for (const ImageScore& image : images)
    sorted[std::min(bins.size() - 1, std::size_t(image.degrees_to_light / kBinDegrees))].push_back(image);
  for (std::size_t i = 0; i < bins.size(); ++i) {
    bins[i].images = sorted[i].size();
    if (sorted[i].empty()) continue;
    bins[i].rmse = std::sqrt(mean_of(sorted[i], &ImageScore::mean_squared_error));
    bins[i].dssim = mean_of(sorted[i], &ImageScore::dssim);
  }
  return bins;
}

MethodScore score(std::string name, std::vector<ImageScore> images, std::optional<std::size_t> peak_rss_bytes) {
  return {.name = std::move(name),
          .images = images.size(),
          .rmse = std::sqrt(mean_of(images, &ImageScore::mean_squared_error)),
          .h1 = std::sqrt(mean_of(images, &ImageScore::squared_h1)),
          .dssim = mean_of(images, &ImageScore::dssim),
          .msssim = mean_of(images, &ImageScore::msssim),
          .gmsd = mean_of(images, &ImageScore::gmsd),
          .flip = mean_of(images, &ImageScore::flip),
          .hdr_flip = mean_of(images, &ImageScore::hdr_flip),
          .own_error = mean_of(images, &ImageScore::own_error),
          .seconds_per_image = mean_of(images, &ImageScore::seconds),
          .by_angle = by_angle(images),
          .peak_rss_bytes = peak_rss_bytes,
          .each = std::move(images)};
}

// Compares what methods render with the truth, as one scan is judged.
class Judge {
 public:
  Judge(const core::OlatScan& scan, const EvaluationOptions& options)
      : scan_(scan), options_(options), exposure_(scan.exposure()) {}

  ImageScore compare(const LightInterpolator& method, std::size_t index, const core::Direction& query,
                     const core::Image& truth) const {
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
    ImageScore errors{.index = index, .degrees_to_light = degrees_to_light(method.scan(), query)};
    if (options_.linear_values)
      measure(judged(is, exposure_, true), judged(should, exposure_, true), errors);
    else
      measure(is_shown, should_be_shown, errors);
    errors.flip = flip(is_shown, should_be_shown, scan_.mask());
    if (options_.hdr_flip) errors.hdr_flip = hdr_flip(should, is, scan_.mask());
    if (options_.own_metric) errors.own_error = options_.own_metric(should_be_shown, is_shown, scan_.mask());
    errors.seconds = elapsed.count();
    return errors;
  }

 private:
  void measure(core::ImageView is, core::ImageView should, ImageScore& errors) const {
    errors.mean_squared_error = mean_squared_error(is, should, scan_.mask());
    errors.squared_h1 = squared_h1(is, should, scan_.mask());
    errors.dssim = dssim(is, should, scan_.mask());
    errors.msssim = ms_ssim(is, should, scan_.mask());
    errors.gmsd = gmsd(is, should, scan_.mask());
  }

  static double degrees_to_light(const core::OlatScan& scan, const core::Direction& query) {
    const std::size_t nearest = core::nearest_indices(scan.directions(), query, 1).front();
    return core::degrees_from_radians(core::angle_radians(scan.directions()[nearest], query));
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
  std::vector<MethodScore> scores;
  core::Progress progress("evaluate", ((scan.light_count() - 1) / step + 1) * methods.size());
  for (const InterpolatorFactory& make : methods) {
    const PeakMemory memory;
    std::string name;
    std::vector<ImageScore> images;
    for (std::size_t left_out = 0; left_out < scan.light_count(); left_out += step) {
      core::throw_if_interrupted();
      const std::unique_ptr<LightInterpolator> method = make(without_light(scan, left_out));
      name = method->name();
      images.push_back(judge.compare(*method, left_out, scan.directions()[left_out], *scan.image(left_out)));
      progress.advance();
    }
    scores.push_back(score(name, std::move(images), memory.bytes()));
  }
  return scores;
}

std::vector<MethodScore> evaluate_against_truth(const core::OlatScan& scan,
                                                std::span<const InterpolatorFactory> methods,
                                                std::span<const core::Direction> directions,
                                                const std::function<core::Image(std::size_t)>& truth,
                                                const EvaluationOptions& options) {
  const Judge judge(scan, options);
  std::vector<MethodScore> scores;
  core::Progress progress("evaluate", directions.size() * methods.size());
  for (const InterpolatorFactory& make : methods) {
    const PeakMemory memory;
    const std::unique_ptr<LightInterpolator> method = make(scan);
    std::vector<ImageScore> images;
    for (std::size_t i = 0; i < directions.size(); ++i) {
      core::throw_if_interrupted();
      images.push_back(judge.compare(*method, i, directions[i], truth(i)));
      progress.advance();
    }
    scores.push_back(score(std::string(method->name()), std::move(images), memory.bytes()));
  }
  return scores;
}

core::OlatScan without_light(const core::OlatScan& scan, std::size_t left_out) {
  std::vector<std::size_t> others;
  for (std::size_t i = 0; i < scan.light_count(); ++i)
    if (i != left_out) others.push_back(i);
  return scan.with_lights(others);
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

std::vector<std::size_t> well_spread(std::span<const core::Direction> lights, std::size_t n) {
  if (n == 0) throw core::UsageError("a stage has one light at least, not 0");
  if (lights.empty()) return {};
  std::vector<double> distance(lights.size(), INFINITY);  // to the nearest one chosen
  std::vector<std::size_t> chosen{core::nearest_indices(lights, core::Direction::from_vector({0, 0, 1}), 1).front()};
  while (chosen.size() < std::min(n, lights.size())) {
    const core::Direction& last = lights[chosen.back()];
    for (std::size_t i = 0; i < lights.size(); ++i)
      distance[i] = std::min(distance[i], core::angle_radians(lights[i], last));
    for (const std::size_t i : chosen) distance[i] = -1;  // duplicates stand at distance 0
    chosen.push_back(std::size_t(std::max_element(distance.begin(), distance.end()) - distance.begin()));
  }
  std::sort(chosen.begin(), chosen.end());
  return chosen;
}

int published_neighbours(std::size_t n) {
  constexpr double kLights = 302, kLightsANeighbour = 50;
  constexpr int kMost = 8, kFewest = 4;
  return std::clamp(static_cast<int>(std::lround(kMost - (kLights - double(n)) / kLightsANeighbour)), kFewest, kMost);
}

}  // namespace lightstage::model
