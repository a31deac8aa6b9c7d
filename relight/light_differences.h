// How wrong the captured pictures may be about a light that stands between them, as they themselves tell: each one is compared with what its
// neighbours predict. That costs no synthesis, so that it can be known beforehand where synthesis pays.
#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include "core/direction.h"
#include "core/olat_scan.h"
#include "core/vec3.h"

namespace lightstage::relight {

double root_mean_square(std::span<const double> values);

class LightDifferences {
 public:
  // Looks at some thousand pixels inside the mask, evenly spread, of every image. O(lights^2 + lights x pixels).
  explicit LightDifferences(const core::OlatScan& scan);

  // Median angle between neighbouring lights, radians.
  double spacing() const { return spacing_; }

  struct NearestLight {
    std::size_t index = 0;
    double angle = 0;  // radians
  };
  NearestLight nearest(const core::Direction& query) const;

  // Whether a query with this nearest light stands between lights, and not in a hole of the stage: no farther than three quarters of the spacing from it
  // (the middle of an even triangle of lights is 0.58 away).
  bool between_lights(const NearestLight& light) const { return light.angle <= 0.75 * spacing_; }

  // The root mean square over mask and channels, in linear radiance under a unit light, by which a synthesised picture is expected to differ from the
  // interpolated captured ones: 0 where a light stands, and growing with the angle to it as far as one and a half spacings. The nearest light's own difference
  // from the mean of its neighbours is the scale; the shipped network, between the lights of simulated heads, stays at 0.6 to 0.9 of it.
  double expected(const NearestLight& light) const;

  // Adds to `colours`, one a captured light, `amount` times a light minus the mean of its neighbours: a weighted sum of the captured images that looks as
  // the errors near that light do.
  void add_difference(std::size_t light, core::Vec3 amount, std::span<core::Vec3> colours) const;

  // The root mean square of that difference for a unit light.
  double of_light(std::size_t light) const { return differences_[light]; }

  // The six nearest others, fewer where there are no more lights.
  std::span<const std::size_t> neighbours(std::size_t light) const { return neighbours_[light]; }

  // All of the following look at the chosen pixels alone. A picture's values there, three a pixel.
  // The picture in which the captured lights shine so.
  std::vector<double> picture(std::span<const core::Vec3> colours) const;
  // The weighted sum of the captured pictures, taken of display-encoded values, minus the same of linear ones: what methods that work in the former say
  // differently, a little darker in places that some of the lights do not reach.
  std::vector<double> display_difference(std::span<const double> weights) const;
  // A picture of the scan's size minus the weighted sum of the captured ones.
  std::vector<double> observed_difference(const core::Image& picture, std::span<const double> weights) const;

 private:
  std::vector<core::Direction> lights_;
  double spacing_;
  std::vector<std::vector<std::size_t>> neighbours_;  // by light
  std::vector<double> differences_;                   // by light
  std::vector<std::size_t> pixels_;                   // that are looked at
  double exposure_;
  std::vector<float> linear_, encoded_;  // [light][value], three values a pixel
};

}  // namespace lightstage::relight
