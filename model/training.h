// Training the super-resolution network on captured scans (Sun et al. 2020, section 4.4).
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "core/olat_scan.h"
#include "model/checkpoint.h"

namespace lightstage::model {

struct TrainOptions {
  NetworkConfig config;
  std::uint64_t seed = 1;
  int crop = 128;                    // pixels; smaller images are taken whole
  int candidates = 16;               // m: the active set is `config.neighbours` of the m lights nearest to the query, at random
  double learning_rate = 1e-3;       // decays to 1/100 along a cosine over the time or step budget
  std::optional<double> minutes;     // stop after so long (wall clock), or
  std::optional<std::int64_t> steps;   // after so many steps; at least one of the two
  int validate_every = 200;          // steps
  int held_out_every = 0;            // recorded in the checkpoint: the scans lack every n-th light, left for evaluation (0: none)
  std::optional<std::filesystem::path> resume;  // a checkpoint written by an earlier run with the same configuration
};

struct LossPoint {
  std::int64_t step = 0;
  double seconds = 0;
  double train = 0;       // masked L1, mean since the last point
  double validation = 0;  // masked L1 on held-out (light, active set) draws, the same every time
};

struct TrainReport {
  std::int64_t steps = 0;
  double seconds = 0;
  std::size_t parameters = 0;
  std::vector<LossPoint> curve;
  double linear_validation = 0;   // the same error for linear blending: the network starts there
  bool stopped_by_nan = false;    // the loss was not finite; the checkpoint is the last good one
};

// Query and truth are one captured light; its active set never holds it, as no capture stands where a user will ask.
// Random crops inside the mask's bounding box, masked L1 on display-encoded values, Adam (0.9, 0.999, 1e-7). Writes the best checkpoint by
// validation to `out` (atomically, at every validation that improves) together with the optimiser's state in OUT.state for resuming, and the
// curve as OUT.csv. Bit-equal for a seed and step budget on one thread, resumed or not. Throws UsageError for scans with fewer lights than
// neighbours + 1, Interrupted on Ctrl-C after writing the checkpoint.
TrainReport train(std::span<const core::OlatScan> scans, const TrainOptions& options, const std::filesystem::path& out);

}  // namespace lightstage::model
