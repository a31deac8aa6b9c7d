#include "relight/light_differences.h"

#include <algorithm>
#include <cmath>

#include "core/display.h"
#include "core/parallel.h"
#include "core/sphere.h"

namespace lightstage::relight {

namespace {

constexpr std::size_t kNeighbours = 6;  // of a light among lights that are evenly spread
constexpr std::size_t kMostPixels = 4096;
constexpr std::size_t kMostValues = std::size_t(1) << 26;  // of all images together

// Offsets of some masked pixels, evenly taken from all of them.
std::vector<std::size_t> some_pixels(const core::OlatScan& scan) {
  const std::size_t wanted = std::max<std::size_t>(
      64, std::min(kMostPixels, kMostValues / (3 * std::max<std::size_t>(1, scan.light_count()))));
  const core::Image& mask = scan.mask();
  std::vector<std::size_t> inside;
  for (std::size_t i = 0; i < mask.values().size(); ++i) {
    if (mask.values()[i] > 0.5F) inside.push_back(i);
  }
  const std::size_t count = std::min(wanted, inside.size());
  std::vector<std::size_t> some;
  for (std::size_t i = 0; i < count; ++i) some.push_back(inside[i * inside.size() / count]);
  return some;
}

// Three values a pixel, whatever the number of channels.
void values_of(const core::Image& image, std::span<const std::size_t> pixels, std::span<float> out) {
  const std::size_t channels = std::size_t(image.channels());
  for (std::size_t p = 0; p < pixels.size(); ++p) {
    const float* pixel = image.values().data() + pixels[p] * channels;
    for (std::size_t c = 0; c < 3; ++c) out[3 * p + c] = pixel[channels >= 3 ? c : 0];
  }
}

// Of rows of so many values, one a light.
std::vector<double> sum(std::span<const float> rows, std::span<const double> weights, std::size_t values) {
  std::vector<double> sums(values);
  for (std::size_t light = 0; light < weights.size(); ++light) {
    if (weights[light] == 0) continue;
    const float* row = rows.data() + light * values;
    for (std::size_t v = 0; v < values; ++v) sums[v] += weights[light] * double(row[v]);
  }
  return sums;
}

}  // namespace

double root_mean_square(std::span<const double> values) {
  double squares = 0;
  for (const double v : values) squares += v * v;
  return values.empty() ? 0 : std::sqrt(squares / double(values.size()));
}

LightDifferences::LightDifferences(const core::OlatScan& scan)
    : lights_(scan.directions()),
      spacing_(core::median_spacing_radians(lights_)),
      pixels_(some_pixels(scan)),
      exposure_(scan.exposure()) {
  const std::size_t n = lights_.size(), values = 3 * pixels_.size();
  linear_.resize(n * values);
  encoded_.resize(n * values);
  neighbours_.resize(n);
  core::parallel_for(n, 1, [&](std::size_t first, std::size_t last) {
    for (std::size_t light = first; light < last; ++light) {
      const std::span<float> row = std::span(linear_).subspan(light * values, values);
      values_of(*scan.image(light), pixels_, row);
      for (std::size_t v = 0; v < values; ++v)
        encoded_[light * values + v] = core::display_encode(float(double(row[v]) / exposure_));
      for (const std::size_t other : core::nearest_indices(lights_, lights_[light], kNeighbours + 1)) {
        if (other != light && neighbours_[light].size() < kNeighbours) neighbours_[light].push_back(other);
      }
    }
  });
  differences_.resize(n);
  core::parallel_for(n, 8, [&](std::size_t first, std::size_t last) {
    for (std::size_t light = first; light < last; ++light) {
      std::vector<double> weights(n);
      weights[light] = 1;
      for (const std::size_t other : neighbours_[light]) weights[other] -= 1.0 / double(neighbours_[light].size());
      differences_[light] = root_mean_square(sum(linear_, weights, values));
    }
  });
}

LightDifferences::NearestLight LightDifferences::nearest(const core::Direction& query) const {
  std::size_t index = 0;
  double least = 5;  // of squared chords
  for (std::size_t i = 0; i < lights_.size(); ++i) {
    const core::Vec3 chord = lights_[i].vec() - query.vec();
    const double squared = core::dot(chord, chord);
    if (squared < least) {
      least = squared;
      index = i;
    }
  }
  return {index, core::angle_radians(lights_[index], query)};
}

double LightDifferences::expected(const NearestLight& light) const {
  constexpr double kFarthest = 1.5;  // spacings; beyond, pictures differ from the rim's as much as they can
  return differences_[light.index] * std::min(kFarthest, light.angle / spacing_);
}

void LightDifferences::add_difference(std::size_t light, core::Vec3 amount, std::span<core::Vec3> colours) const {
  colours[light] = colours[light] + amount;
  for (const std::size_t other : neighbours_[light])
    colours[other] = colours[other] - amount / double(neighbours_[light].size());
}

std::vector<double> LightDifferences::picture(std::span<const core::Vec3> colours) const {
  std::vector<double> sums(3 * pixels_.size());
  for (std::size_t light = 0; light < lights_.size(); ++light) {
    const double factors[3] = {colours[light].x, colours[light].y, colours[light].z};
    const float* values = linear_.data() + light * sums.size();
    for (std::size_t i = 0; i < sums.size(); ++i) sums[i] += factors[i % 3] * double(values[i]);
  }
  return sums;
}

std::vector<double> LightDifferences::display_difference(std::span<const double> weights) const {
  std::vector<double> result = sum(encoded_, weights, 3 * pixels_.size());
  const std::vector<double> linear = sum(linear_, weights, result.size());
  for (std::size_t i = 0; i < result.size(); ++i)
    result[i] = exposure_ * double(core::display_decode(float(result[i]))) - linear[i];
  return result;
}

std::vector<double> LightDifferences::observed_difference(const core::Image& picture,
                                                          std::span<const double> weights) const {
  std::vector<float> seen(3 * pixels_.size());
  values_of(picture, pixels_, seen);
  std::vector<double> result = sum(linear_, weights, seen.size());
  for (std::size_t i = 0; i < result.size(); ++i) result[i] = double(seen[i]) - result[i];
  return result;
}

}  // namespace lightstage::relight
