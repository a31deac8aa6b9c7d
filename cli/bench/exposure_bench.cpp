#include "cli/bench/exposure_bench.h"

#include <algorithm>
#include <cmath>
#include <cstdint>

#include "core/exposure_merge.h"
#include "core/stopwatch.h"
#include "sim/sensor.h"

namespace lightstage::cli {

namespace {

constexpr int kStops = 14;
constexpr double kBrightest = 0.78;  // below where a value loses its weight
constexpr core::Nanoseconds kShortest = core::kMillisecond;

// A row of pixels for each half stop.
core::Image steps_of_radiance(int pixels, double brightest) {
  core::Image radiance(2 * kStops + 1, pixels, 1);
  for (int y = 0; y < radiance.height(); ++y) {
    for (int x = 0; x < pixels; ++x) radiance(y, x) = float(brightest * std::exp2(-0.5 * y));
  }
  return radiance;
}

}  // namespace

BracketRow measure_bracket(const BracketKnobs& knobs, int pixels) {
  sim::SensorSpec sensor;
  sensor.vignetting = 0;
  const double scale = sim::saturation_radiance(1, kShortest);
  const core::Image truth = steps_of_radiance(pixels, kBrightest * scale);
  BracketRow row;
  row.knobs = knobs;
  std::vector<core::Image> images;
  std::vector<core::Nanoseconds> times;
  for (int i = 0; i < knobs.exposures; ++i) {
    times.push_back(std::llround(double(kShortest) * std::exp2(i * knobs.stops_between)));
    images.push_back(sim::sense(truth, sensor, 1, times.back(), std::uint64_t(1 + i)));
    row.seconds += double(times.back()) / double(kShortest);
  }
  std::vector<core::Exposure> exposures;
  for (std::size_t i = 0; i < images.size(); ++i) {
    exposures.push_back({images[i], double(times[i]) / core::kSecond, sim::saturation_radiance(1, times[i]), {}});
  }
  const core::Stopwatch watch;
  const core::Image merged = core::merge_exposures(exposures, knobs.read_noise_share).image;
  row.merge_seconds = watch.seconds() * 1e6 / double(merged.values().size());

  // Proportional to within one factor, which the levels' means give by least squares of their logarithms, certain ones counting for more.
  std::vector<double> ratio, weight;
  double noise = 0;
  for (int y = 0; y < merged.height(); ++y) {
    double sum = 0, squares = 0;
    for (int x = 0; x < pixels; ++x) {
      const double relative = double(merged(y, x)) / double(truth(y, x));
      sum += relative;
      squares += (relative - 1) * (relative - 1);
    }
    ratio.push_back(sum / pixels);
    weight.push_back(1 / (squares / pixels));
    noise += squares / pixels / merged.height();
  }
  double factor = 0, weights = 0;
  for (std::size_t i = 0; i < ratio.size(); ++i) {
    factor += weight[i] * ratio[i];
    weights += weight[i];
  }
  factor /= weights;
  for (const double r : ratio) {
    row.largest_deviation_percent = std::max(row.largest_deviation_percent, 100 * std::abs(r / factor - 1));
  }
  row.noise_percent = 100 * std::sqrt(noise);
  return row;
}

double hdr_linearity_percent() {
  return measure_bracket({}).largest_deviation_percent;
}

std::vector<BracketRow> bracket_frontier() {
  std::vector<BracketRow> rows;
  constexpr int kPixels = 10000;
  for (const int exposures : {1, 2, 3, 4, 5, 7}) {
    for (const double stops : {1.0, 2.0, 3.0, 4.0}) {
      // Beyond 12 stops even the darkest level clips the longest exposure.
      if ((exposures - 1) * stops > 12 || (exposures == 1 && stops != 1.0)) continue;
      rows.push_back(measure_bracket({exposures, stops, core::kUsualReadNoiseShare}, kPixels));
    }
  }
  for (const double share : {0.0, 1000.0}) rows.push_back(measure_bracket({5, 2, share}, kPixels));
  return rows;
}

}  // namespace lightstage::cli
