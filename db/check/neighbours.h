// The lights around a light, and how much each says about the picture there.
#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include "core/direction.h"

namespace lightstage::db {

struct Neighbour {
  std::size_t index = 0;
  double weight = 0;  // falls with the angle; the weights of one place sum to 1
};

// The `count` usable lights nearest to light `place` (itself left out), weighted by the inverse of their
// angle to it.
std::vector<Neighbour> neighbours(std::span<const core::Direction> directions, std::size_t place, std::size_t count,
                                  const std::vector<bool>& usable);

}  // namespace lightstage::db
