#include "model/pareto_front.h"

#include <algorithm>
#include <cmath>

namespace lightstage::model {

namespace {

bool finite(const CostAndError& point) {
  return std::isfinite(point.cost) && std::isfinite(point.error);
}

bool dominates(const CostAndError& a, const CostAndError& b) {
  return finite(a) && a.cost <= b.cost && a.error <= b.error && (a.cost < b.cost || a.error < b.error);
}

}  // namespace

std::vector<bool> pareto_front(std::span<const CostAndError> points) {
  std::vector<bool> on_front;
  for (const CostAndError& point : points) {
    on_front.push_back(finite(point) && std::none_of(points.begin(), points.end(), [&](const CostAndError& other) {
                         return dominates(other, point);
                       }));
  }
  return on_front;
}

}  // namespace lightstage::model
