#include "relight/smooth_light.h"

#include <algorithm>

#include "core/parallel.h"

namespace lightstage::relight {

namespace {

double median(std::vector<double> values) {
  const auto middle = values.begin() + std::ptrdiff_t(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

// By captured light: the mean radiance (times pi) of the patches to which it is the nearest.
std::vector<core::Vec3> radiance_around(std::span<const Patch> patches,
                                        std::span<const LightDifferences::NearestLight> nearest, std::size_t lights) {
  std::vector<core::Vec3> sums(lights);
  std::vector<double> solid_angles(lights);
  for (std::size_t p = 0; p < patches.size(); ++p) {
    sums[nearest[p].index] = sums[nearest[p].index] + patches[p].light.irradiance;
    solid_angles[nearest[p].index] += patches[p].solid_angle;
  }
  for (std::size_t i = 0; i < lights; ++i) {
    if (solid_angles[i] > 0) sums[i] = sums[i] / solid_angles[i];
  }
  return sums;
}

}  // namespace

std::vector<core::Vec3> smooth_light(std::span<const Patch> patches,
                                     std::span<const LightDifferences::NearestLight> nearest,
                                     const LightDifferences& lights, const model::LightInterpolator& barycentric) {
  const std::size_t n = barycentric.scan().light_count();
  const std::vector<core::Vec3> around = radiance_around(patches, nearest, n);
  std::vector<core::Vec3> smooth(n);
  for (std::size_t i = 0; i < n; ++i) {
    std::vector<double> red{around[i].x}, green{around[i].y}, blue{around[i].z};
    for (const std::size_t other : lights.neighbours(i)) {
      red.push_back(around[other].x);
      green.push_back(around[other].y);
      blue.push_back(around[other].z);
    }
    smooth[i] = {median(red), median(green), median(blue)};
  }
  std::vector<core::Vec3> result(patches.size());
  core::parallel_for(patches.size(), 256, [&](std::size_t first, std::size_t last) {
    for (std::size_t p = first; p < last; ++p) {
      if (!lights.between_lights(nearest[p])) continue;
      const std::vector<double> weights = barycentric.linear_weights(patches[p].light.direction);
      for (std::size_t i = 0; i < n; ++i) {
        if (weights[i] != 0) result[p] = result[p] + (weights[i] * patches[p].solid_angle) * smooth[i];
      }
    }
  });
  return result;
}

}  // namespace lightstage::relight
