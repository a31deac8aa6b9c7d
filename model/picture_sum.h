// Light adds up: the picture under many lights is the sum of the pictures under each, times its colour.
#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include "core/image.h"
#include "core/olat_scan.h"
#include "core/vec3.h"

namespace lightstage::model {

// A weighted sum of pictures of one size, in float64, in the order in which they are added: the result is
// bit-equal for every thread count. Memory: 8 bytes a value, and at most 16 pictures of a scan at a time,
// however many it has.
class PictureSum {
 public:
  // Throws BadInput for a size without values.
  explicit PictureSum(core::ImageSize size);

  // Adds the picture times one factor a channel. Picture and sum must have 3 channels. Throws BadInput for
  // another size.
  void add(const core::Image& picture, core::Vec3 colour);

  // Adds pictures that are in memory, each times its colour. Throws as above, and unless there is one colour a picture.
  void add(std::span<const core::Image> pictures, std::span<const core::Vec3> colours);

  // Adds every image of the scan times its weight. Images whose weight is exactly 0 are not loaded. Throws
  // BadInput unless there is one finite weight a light and the sizes are equal, and what loading an image
  // throws; the sum is then of no more use.
  void add(const core::OlatScan& scan, std::span<const double> weights);
  // The same with a colour a light; the sum must have 3 channels, the scan's images are taken as RGB
  // (core::to_rgb).
  void add(const core::OlatScan& scan, std::span<const core::Vec3> colours);

  // The sum, each value rounded to float32 once.
  core::Image result() const;

 private:
  struct Terms;
  void add(const Terms& terms);
  template <class Weight>
  void add_scan(const core::OlatScan& scan, std::span<const Weight> weights);

  core::ImageSize size_;
  std::vector<double> sums_;
};

}  // namespace lightstage::model
