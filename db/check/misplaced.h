// Pictures that belong to another light than the one they are filed under.
#pragma once

#include <optional>
#include <span>
#include <vector>

#include "core/direction.h"
#include "core/image.h"

namespace lightstage::db {

struct Misplaced {
  std::size_t index = 0;
  std::size_t resembles = 0;  // the light around which it would fit best
  bool swapped = false;       // and the picture filed there fits here
};

// Compares every picture's shading (thumbnails of kShapeSide, display-encoded, freed of mean and contrast)
// with what the 4 lights around every light predict there. Named are two pictures, far apart, that both fit
// better in each other's place, and a picture that fits far better elsewhere than in its own. Far apart: 30
// degrees and two light spacings. Empty for fewer than 16 pictures. O(n^2) in the number of pictures, on all
// threads. On the real sets own places fit better than any far one but for a few dark pictures (error ratio
// up to 1.43, in pairs 1.2); pairs swapped on purpose begin at 1.8. The bounds are 1.8 for one and 1.4 for a
// pair.
std::vector<Misplaced> find_misplaced(std::span<const core::Direction> directions,
                                      std::span<const core::Image> thumbnails, const core::Image& mask);

}  // namespace lightstage::db
