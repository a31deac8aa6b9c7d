// Which pictures a growing network is trained on when (Sun et al. 2020, section 4.4): level d stands for pictures averaged down to 1 / 2^d of the size.
#pragma once

#include <vector>

namespace lightstage::model {

struct LevelWeight {
  int level = 0;
  double weight = 0;
};

// Where training stands after `fraction` = t / T of its budget (0 to 1): K (T - t) / T for K levels, limited to K - 1, the coarsest. So each level has an
// equal share of the time, the coarsest a first one of its own, and at t = T the finest stands alone. As published the coarsest level would fade in from
// weight 0 in that first share; as nothing is there to fade from, it has weight 1.
double level_position(double fraction, int levels);

// The levels with a_d = max(0, 1 - |position - d|) > 0, finest first: one, or two that sum to 1. All others need not be computed.
std::vector<LevelWeight> active_levels(double position);

// How far the last stage, in which the finest level takes over, has come: 0 before it, 1 at its end.
double last_stage(double position);

}  // namespace lightstage::model
