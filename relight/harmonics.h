// Lat-long maps as real spherical harmonics: how fine the light is, and maps of chosen fineness.
//
// A map is taken for what Environment says it is: pixels are areas that tile the sphere, each of one radiance. Coefficients are the exact
// integrals of that function, and maps made from coefficients hold the exact mean over each pixel; so light is kept (degree 0 to rounding,
// whatever the size), maps of 1x2 pixels are as valid as others, and a single bright pixel is a disc-like source and no point. The price is
// that pixels blur: of what there is of degree l, drawing or reading a map H pixels high keeps 1 - (pi l / H)^2 / 12 of the energy, about.
//
// Y_lm = N_lm P_l|m|(sin latitude) times sqrt(2) cos(m longitude) for m > 0, 1 for m = 0, sqrt(2) sin(|m| longitude) for m < 0, orthonormal
// over the sphere, without the Condon-Shortley phase. The axis is +y; longitude and latitude are those of Environment.
#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include "core/image.h"
#include "core/vec3.h"

namespace lightstage::relight {

class Harmonics {
 public:
  static constexpr int kMaxDegree = 1000;  // far above it the recurrences would underflow near the poles

  // The coefficients up to `degree` of a map of 1 to 4 channels (grey is repeated, alpha dropped), which may be negative; of an Environment:
  // its radiance(). Float64 throughout; the result does not depend on the thread count. Time: a Fourier transform a row and height x degree^2
  // operations, in all about that of reading the map from a file. Memory: height x degree x 48 bytes. Throws UsageError for a degree outside
  // 0 .. kMaxDegree, BadInput for an empty map and for NaN or infinity (with the pixel).
  Harmonics(core::ImageView map, int degree);

  int degree() const { return degree_; }
  // Red, green and blue of Y_lm, in radiance times the root of steradians; 0 <= l <= degree(), -l <= m <= l.
  core::Vec3 coefficient(int l, int m) const { return coefficients_[std::size_t(std::ptrdiff_t(l) * (l + 1) + m)]; }

  // For each degree, the sum over m and the three channels of the squared coefficients: the integral over the sphere of the squared radiance of
  // that degree, in radiance^2 steradians, unchanged by rotations of the light. All degrees together have the integral of the squared map.
  std::vector<double> energy_by_degree() const;

  // The light with each degree multiplied by its weight, as pixel means of a map of 3 channels. It may be negative (an Environment would
  // clip that, and so add light). Throws UsageError for sizes < 1 and unless there is one weight for each degree.
  core::Image map(int height, int width, std::span<const double> weight_of_degree) const;

 private:
  int degree_;
  std::vector<core::Vec3> coefficients_;
};

// The map with its degrees weighted; degrees that have no weight are left out. Of the size of `map`, 3 channels, may be negative; throws as above.
core::Image filtered(core::ImageView map, std::span<const double> weight_of_degree);

// Weights that keep all of degrees 0 .. `last_whole`, and of those between it and `first_gone` less and less (a raised cosine: a sharp cut
// would ring). Throws UsageError unless 0 <= last_whole < first_gone <= kMaxDegree + 1.
std::vector<double> cutoff_weights(int last_whole, int first_gone);

// Weights exp(-l (l + 1) sigma^2 / 2), the sphere's Gaussian blur (its heat kernel), to where they fall below 1e-9. The kernel is positive:
// what was light stays light, but for rounding. Throws UsageError for a sigma that is not finite or below 0.0065 (0.37 degrees).
std::vector<double> blur_weights(double sigma_radians);

}  // namespace lightstage::relight
