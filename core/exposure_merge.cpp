#include "core/exposure_merge.h"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <string>

#include "core/error.h"
#include "core/image_file.h"
#include "core/parallel.h"

namespace lightstage::core {

namespace {

constexpr double kTaperFrom = 0.8;
constexpr double kReliable = 0.95;
constexpr std::size_t kRowGrain = 16;

void check(std::span<const Exposure> exposures, double read_noise_share) {
  if (exposures.empty()) throw BadInput("there are no exposures to merge");
  if (!(read_noise_share >= 0) || !std::isfinite(read_noise_share)) {
    throw BadInput("merging exposures: the share of read noise must be a number >= 0");
  }
  const ImageSize size = exposures.front().image.size();
  for (std::size_t i = 0; i < exposures.size(); ++i) {
    const Exposure& e = exposures[i];
    const std::string what = "exposure " + std::to_string(i);
    if (e.image.empty()) throw BadInput(what + " is an empty picture");
    if (e.image.size() != size) throw BadInput(what + " is of another size than exposure 0");
    if (!e.dark.empty() && e.dark.size() != size) throw BadInput(what + ": its dark frame is of another size");
    if (!(e.seconds > 0) || !std::isfinite(e.seconds)) throw BadInput(what + ": its time must be positive");
    if (!(e.saturation >= 0) || !std::isfinite(e.saturation)) {
      throw BadInput(what + ": its saturation must be a number >= 0");
    }
    require_finite(e.image, what);
    if (!e.dark.empty()) require_finite(e.dark, what + ", dark frame");
  }
}

// 1 below kTaperFrom of saturation, 0 from kReliable on, and smooth between.
double reliability(double value, double saturation) {
  if (!(saturation > 0)) return 1;
  const double t = std::clamp((kReliable - value / saturation) / (kReliable - kTaperFrom), 0.0, 1.0);
  return t * t * (3 - 2 * t);
}

class Merge {
 public:
  Merge(std::span<const Exposure> exposures, double read_noise_share)
      : exposures_(exposures), read_noise_share_(read_noise_share) {
    const auto limit = [](const Exposure& e) { return e.saturation > 0 ? e.saturation : HUGE_VAL; };
    last_ = std::size_t(std::max_element(exposures.begin(), exposures.end(),
                                         [&](const auto& a, const auto& b) { return limit(a) < limit(b); }) -
                        exposures.begin());
    by_time_ = std::any_of(exposures.begin(), exposures.end(), [](const Exposure& e) { return !(e.saturation > 0); });
  }

  // Of exposure i at value x of row y.
  double value(std::size_t i, int y, std::size_t x) const {
    const Exposure& e = exposures_[i];
    return double(e.image.row(y)[x]) - (e.dark.empty() ? 0.0 : double(e.dark.row(y)[x]));
  }

  // Whether any exposure shows the value; `trust` is room for one number an exposure.
  bool merge(int y, std::size_t x, std::vector<double>& trust, float& merged) const {
    // Means weighted by time, and by its square.
    double photons = 0, seconds = 0, steady = 0, squares = 0;
    for (std::size_t i = 0; i < exposures_.size(); ++i) {
      const Exposure& e = exposures_[i];
      const double v = value(i, y, x);
      trust[i] = reliability(double(e.image.row(y)[x]), e.saturation) * e.seconds;
      photons += trust[i] * v;
      seconds += trust[i];
      steady += trust[i] * e.seconds * v;
      squares += trust[i] * e.seconds;
    }
    if (!(seconds > 0)) {
      merged = float(value(last_, y, x));
      return false;
    }
    const double radiance = std::max(0.0, steady / squares);
    if (by_time_ || exposures_.size() == 1 || !(radiance + read_noise_share_ > 0)) {
      merged = float(photons / seconds);
      return true;
    }
    double sum = 0, weights = 0;
    for (std::size_t i = 0; i < exposures_.size(); ++i) {
      if (!(trust[i] > 0)) continue;
      const double weight = trust[i] / (radiance + read_noise_share_ * exposures_[i].saturation);
      sum += weight * value(i, y, x);
      weights += weight;
    }
    merged = float(sum / weights);
    return true;
  }

 private:
  std::span<const Exposure> exposures_;
  double read_noise_share_;
  std::size_t last_ = 0;  // the exposure that saturates last
  bool by_time_ = false;
};

}  // namespace

MergedExposures merge_exposures(std::span<const Exposure> exposures, double read_noise_share) {
  check(exposures, read_noise_share);
  const ImageSize size = exposures.front().image.size();
  const Merge merge(exposures, read_noise_share);
  MergedExposures result{Image(size), Image(size.height, size.width, 1), 0};
  std::atomic<std::size_t> saturated{0};
  const auto channels = std::size_t(size.channels);
  parallel_for(std::size_t(size.height), kRowGrain, [&](std::size_t first, std::size_t last) {
    std::vector<double> trust(exposures.size());
    std::size_t lost = 0;
    for (std::size_t row = first; row < last; ++row) {
      const int y = int(row);
      float* out = result.image.pixel(y, 0);
      for (std::size_t x = 0; x < std::size_t(size.width) * channels; ++x) {
        if (merge.merge(y, x, trust, out[x])) continue;
        result.saturated(y, int(x / channels)) = 1;
        ++lost;
      }
    }
    saturated += lost;
  });
  result.saturated_values = saturated;
  return result;
}

}  // namespace lightstage::core
