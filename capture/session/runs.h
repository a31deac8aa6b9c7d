// A pass cut into runs: steps that follow each other with one exposure.
#pragma once

#include <vector>

#include "db/store.h"

namespace lightstage::capture {

struct Run {
  core::Nanoseconds exposure = 0;
  std::vector<const db::Step*> steps;
};

// In the order given; none longer than `longest` (their frames wait in memory for their step to be certain).
inline std::vector<Run> cut_into_runs(const std::vector<const db::Step*>& steps, std::size_t longest) {
  std::vector<Run> runs;
  for (const db::Step* step : steps) {
    if (runs.empty() || runs.back().exposure != step->exposure_ns || runs.back().steps.size() >= longest) {
      runs.push_back({step->exposure_ns, {}});
    }
    runs.back().steps.push_back(step);
  }
  return runs;
}

}  // namespace lightstage::capture
