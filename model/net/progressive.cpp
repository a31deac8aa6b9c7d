#include "model/net/progressive.h"

#include <algorithm>
#include <cmath>

namespace lightstage::model {

double level_position(double fraction, int levels) {
  return std::clamp(levels * (1 - fraction), 0.0, levels - 1.0);
}

std::vector<LevelWeight> active_levels(double position) {
  const double finer = std::floor(position);
  const double part = position - finer;
  std::vector<LevelWeight> active{{int(finer), 1 - part}};
  if (part > 0) active.push_back({int(finer) + 1, part});
  return active;
}

double last_stage(double position) {
  return std::max(0.0, 1 - position);
}

}  // namespace lightstage::model
