// Textured pictures with a known motion.
#pragma once

#include <cstdint>
#include <functional>

#include "align/flow.h"
#include "core/image.h"

namespace lightstage::test {

// Where what is at (x, y) of the reference lies in the other picture, relative to (x, y).
using Motion = std::function<std::pair<double, double>(double x, double y)>;

// A smooth random texture of radiance about 0.05 to 1, exact at every real position, the same for a seed.
class Texture {
 public:
  explicit Texture(std::uint64_t seed);
  double operator()(double x, double y) const;

 private:
  struct Wave {
    double kx, ky, phase, amplitude;
  };
  std::vector<Wave> waves_;
};

core::Image picture_of(const Texture& texture, int height, int width);
// The other picture of a pair: other(p + motion(p)) = texture(p).
core::Image moved_picture_of(const Texture& texture, int height, int width, const Motion& motion);
align::FlowField flow_of(const Motion& motion, int height, int width);

// Shot and read noise of a sensor with 12000 electrons at value 1, 12 bits.
core::Image noisy(const core::Image& image, double exposure, std::uint64_t seed);

// Median length of the difference, a border left out.
double median_end_point_error(const align::FlowField& a, const align::FlowField& b, int border);
double psnr(const core::Image& a, const core::Image& b, int border);

}  // namespace lightstage::test
