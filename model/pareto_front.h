// Which of several ways are worth their cost.
#pragma once

#include <span>
#include <vector>

namespace lightstage::model {

struct CostAndError {
  double cost = 0, error = 0;
};

// For each point whether no other one is at least as good in both and better in one. Points that are not finite are never on the front, and
// put no other off it; of equal points all are. O(n^2).
std::vector<bool> pareto_front(std::span<const CostAndError> points);

}  // namespace lightstage::model
