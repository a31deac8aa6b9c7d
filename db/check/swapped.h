// Two pictures that stand under each other's light in a list.
#pragma once

#include <span>
#include <utility>
#include <vector>

#include "core/direction.h"
#include "core/image.h"

namespace lightstage::db {

// Pairs of indices, of lights however close. Each place is predicted from the 12 lights nearest to it, without the two in question, by radial
// basis functions (the angle, with a constant); a pair is named when both pictures together are predicted more than 1.15 times better at each
// other's places than at their own. `thumbnails` of kShapeSide; display-encoded and made equally bright here, so that lights of different
// strength matter little; the mask weighs pixels. Where nearest neighbours hardly differ, nothing is accused. Empty for fewer than 16 pictures, or
// pictures of less than 64 pixels in the thumbnail. O(n^2) in the number of pictures, on all threads. On the real sets
// sound pairs stay below 0.86, and two neighbours swapped on purpose begin at 1.17.
std::vector<std::pair<std::size_t, std::size_t>> find_swapped(std::span<const core::Direction> directions,
                                                              std::span<const core::Image> thumbnails,
                                                              const core::Image& mask);

}  // namespace lightstage::db
