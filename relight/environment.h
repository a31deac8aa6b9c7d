// Lat-long environment maps: 2N x N, image up is +y, image centre is +z, longitude +90 degrees is +x (OpenEXR's envmap).
#pragma once

#include <filesystem>
#include <vector>

#include "core/direction.h"
#include "core/image.h"

namespace lightstage::relight {

class Environment {
 public:
  // Takes linear radiance, 1 or 3 channels; any size of at least 1x1. Throws BadInput for NaN or infinity (with the pixel).
  // Negative values (resampling leaves such) count as 0; how many there were is told by negative_values().
  explicit Environment(core::ImageView radiance);
  static Environment read(const std::filesystem::path& path);

  int width() const;
  int height() const;
  std::size_t negative_values() const;

  // The direction of a pixel's centre, and the solid angle of the pixel (exact: 2 pi / width times the difference of the
  // latitudes' sines, so the sum over the map is 4 pi).
  core::Direction direction(int y, int x) const;
  double solid_angle(int y) const;
  const core::Image& radiance() const;  // 3 channels, not negative

  // Turned about +y: what was at longitude 0 comes to `degrees`. Exact for multiples of a pixel, linear in between.
  Environment rotated(double degrees) const;

  // The map's light gathered into one RGB irradiance (radiance x solid angle, in units of pi as core::Light::gain) per direction: every
  // pixel gives all of its energy to the nearest of the directions. Sums are compensated; energy is kept to rounding.
  std::vector<core::Vec3> gather(const std::vector<core::Direction>& directions) const;

 private:
  core::Image radiance_;
  std::size_t negative_values_ = 0;
};

}  // namespace lightstage::relight
