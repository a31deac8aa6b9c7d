#include "relight/area_light.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <string>

#include "core/error.h"
#include "core/sphere.h"
#include "core/text.h"

namespace lightstage::relight {

namespace {

void require_radius(double radius_degrees) {
  if (!(radius_degrees >= 0 && radius_degrees <= 180))
    throw core::UsageError("the radius of an area light must be 0 to 180 degrees, not " +
                           core::number_text(radius_degrees));
}

// 1 - cos(radius), which is also the cap's area over 2 pi; exact for small ones.
double cap_height(double radius_degrees) {
  const double half_sine = std::sin(core::radians_from_degrees(radius_degrees) / 2);
  return 2 * half_sine * half_sine;
}

}  // namespace

// The k-th of n has 1 - cos(angle to the axis) = (k + 1/2)/n of the cap's, and successive ones turn by the golden angle.
std::vector<core::Direction> cap_directions(const core::Direction& axis, double radius_degrees, int samples) {
  require_radius(radius_degrees);
  if (samples < 1) throw core::UsageError("an area light needs at least 1 sample, not " + std::to_string(samples));
  if (samples == 1) return {axis};
  const core::Vec3 z = axis.vec();
  const core::Vec3 least = std::abs(z.y) < 0.9 ? core::Vec3{0, 1, 0} : core::Vec3{1, 0, 0};
  const core::Vec3 x = core::Direction::from_vector(core::cross(least, z)).vec();
  const core::Vec3 y = core::cross(z, x);
  const double whole = cap_height(radius_degrees);
  const double golden_angle = 2 * std::numbers::pi * (2 - std::numbers::phi);
  std::vector<core::Direction> directions;
  for (int k = 0; k < samples; ++k) {
    const double height = whole * (double(k) + 0.5) / double(samples);
    const double radius = std::sqrt(height * (2 - height));
    const double turn = golden_angle * double(k);
    directions.push_back(
        core::Direction::from_vector((1 - height) * z + (radius * std::cos(turn)) * x + (radius * std::sin(turn)) * y));
  }
  return directions;
}

// Two things can betray single samples.
//
// A shadow's edge: under each sample it is sharp, and the penumbra is a staircase of n of them. What casts it is seldom farther
// than half the picture's height H from where it falls, so that across the light's diameter 2 r the edge sweeps at most
// (H/2) 2 r = H r pixels. No two directions of the spiral fall together when they are projected on the edge's way, so the
// stairs are 1/n of the light high (at the worst place the sum is 1.4/n off). 128 of them are below what eight bits show of
// all but the darkest places; below a sweep of one pixel fewer will do, since an edge is itself a pixel soft; and with more pixels than
// stairs, every pixel gets one of its own. This grows with r.
//
// Highlights and whatever else changes with the light in both of its angles: between the captured lights, D apart, no
// method makes anything appear and vanish again, so that samples a fraction of D apart see all that there is. A quarter
// is enough (tests/relight/area_light_test.cpp holds the sum against 2000 samples). Where the samples only give weights to
// captured pictures they cost nothing, and an eighth is taken, as for the boxes of an environment. This grows with r^2.
int area_samples(const model::LightInterpolator& interpolator, double radius_degrees) {
  require_radius(radius_degrees);
  if (radius_degrees == 0) return 1;
  constexpr double kMost = 100000, kStairs = 128;
  const core::OlatScan& scan = interpolator.scan();
  const bool has_linear_weights = !interpolator.linear_weights(core::Direction()).empty();
  const double between = core::median_spacing_radians(scan.directions()) / (has_linear_weights ? 8 : 4);
  const double sweep = scan.image_size().height * core::radians_from_degrees(radius_degrees);
  const double for_edges = std::max(kStairs * std::min(1.0, sweep), sweep);
  const double for_highlights = 2 * std::numbers::pi * cap_height(radius_degrees) / (between * between);
  return static_cast<int>(std::ceil(std::clamp(std::max(for_edges, for_highlights), 1.0, kMost)));
}

}  // namespace lightstage::relight
