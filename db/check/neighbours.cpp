#include "db/check/neighbours.h"

#include "core/sphere.h"

namespace lightstage::db {

std::vector<Neighbour> neighbours(std::span<const core::Direction> directions, std::size_t place, std::size_t count,
                                  const std::vector<bool>& usable) {
  // Half a degree, so that a light which stands twice in the list does not silence all others.
  constexpr double kSoftening = 0.01;
  std::vector<Neighbour> found;
  double sum = 0;
  for (const std::size_t index : core::nearest_indices(directions, directions[place], directions.size())) {
    if (index == place || !usable[index]) continue;
    const double weight = 1 / (core::angle_radians(directions[place], directions[index]) + kSoftening);
    found.push_back({index, weight});
    sum += weight;
    if (found.size() == count) break;
  }
  for (Neighbour& neighbour : found) neighbour.weight /= sum;
  return found;
}

}  // namespace lightstage::db
