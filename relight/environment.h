// Lat-long environment maps: 2N x N, image up is +y, image centre is +z. The map is what is seen from the
// subject, so with +z ahead and +y up, +x lies to the LEFT: longitude +90 degrees (+x) is a quarter of the
// width left of the centre, and both sides are longitude +-180 (-z). This is OpenEXR's convention for
// latitude-longitude maps, except that pixels are areas that tile the sphere (a pixel's direction is its
// centre's), where OpenEXR puts the outermost pixel centres on the poles and on the seam.
#pragma once

#include <cstddef>
#include <filesystem>
#include <vector>

#include "core/direction.h"
#include "core/image.h"
#include "model/interpolator.h"

namespace lightstage::relight {

using model::DistantLight;

// Some pixels of a map next to each other.
struct Patch {
  DistantLight
      light;  // of all of them together, at the mean direction of their light; that of their middle where they are dark
  double solid_angle = 0;  // steradians
};

class Environment {
 public:
  // Takes linear radiance of 1 to 4 channels (grey is repeated, alpha dropped); any size of at least 1x1.
  // Throws BadInput for an empty image and for NaN or infinity (with the pixel). Negative values (resampling
  // leaves such) count as 0; how many there were is told by negative_values().
  explicit Environment(core::ImageView radiance);
  static Environment read(const std::filesystem::path& path);

  int width() const { return radiance_.width(); }
  int height() const { return radiance_.height(); }
  std::size_t negative_values() const { return negative_values_; }

  // The direction of a pixel's centre, and the solid angle of the pixel (exact: 2 pi / width times the
  // difference of the latitudes' sines, so the sum over the map is 4 pi).
  core::Direction direction(int y, int x) const;
  double solid_angle(int y) const { return solid_angle(y, height(), width()); }
  static double solid_angle(int y, int height, int width);
  const core::Image& radiance() const { return radiance_; }  // 3 channels, not negative

  // Turned about +y: what was at longitude 0 comes to `degrees` (taken to a billionth). Exact for multiples of a pixel,
  // linear in between; every row keeps its energy; angles that differ by whole turns give bit-equal maps. Throws UsageError for an angle that is not finite.
  Environment rotated(double degrees) const;

  // The map at another size: each pixel is the mean over its area of the pixels that it covers (weighted by solid angle), upwards as downwards,
  // so that energy is kept, pole or seam, to the rounding of a float32 pixel. The same size is bit-equal. Throws UsageError for sizes < 1.
  Environment resized(int width, int height) const;

  // The map as one light per box of pixels no wider and no higher than `box_radians` (at least one pixel),
  // boxes without light left out. The light stands at the energy-weighted mean direction of its pixels, so a
  // small sun stays where it is and the first moment of the light is kept within each box. Energy is kept to
  // rounding. Rows of boxes go from the top, boxes from the left.
  std::vector<DistantLight> lights(double box_radians) const;

  // The same boxes, dark ones too, with their solid angles, which sum to 4 pi.
  std::vector<Patch> patches(double box_radians) const;

  // The map's light gathered onto given directions: every pixel gives all of its energy to the nearest of
  // them (the first of equally near ones). One light per direction, in their order, standing at the
  // energy-weighted mean direction of what it gathered; the given direction itself where that is nothing or
  // has no mean. Energy is kept to rounding. Throws UsageError for no directions. About (pixels / 256) x
  // directions operations and a few a pixel.
  std::vector<DistantLight> gather(const std::vector<core::Direction>& directions) const;

 private:
  core::Image radiance_;
  std::size_t negative_values_ = 0;
};

}  // namespace lightstage::relight
