// Everything that a training run must remember to go on as if it had never stopped: in OUT.state, beside the checkpoint OUT.
#pragma once

#include <torch/torch.h>

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "model/net/network.h"
#include "model/training.h"

namespace lightstage::model {

struct TrainingState {
  std::int64_t step = 0;
  double seconds = 0;   // of training so far
  double loss_sum = 0;  // of the steps since the last point of the curve
  std::int64_t loss_count = 0;
  double guide_validation = 0;
  double first_validation = 0;  // before the first step
  double best_validation = 0;
  std::vector<LossPoint> curve;
};

// OUT.state for a checkpoint OUT.
std::filesystem::path state_path(const std::filesystem::path& checkpoint);

// `fingerprint` is a JSON text that says what the run is about; a run is resumed only with the same. The state file holds the current weights (the
// checkpoint the best), Adam's moments, and the rest as JSON. Written atomically.
void save_state(const std::filesystem::path& path, const TrainingState& state, const std::string& fingerprint,
                const Network& network, const torch::optim::Adam& optimiser);

// Throws BadInput naming the file when it is missing, damaged, or of a run with another fingerprint (and what differs).
TrainingState load_state(const std::filesystem::path& path, const std::string& fingerprint, Network& network,
                         torch::optim::Adam& optimiser);

}  // namespace lightstage::model
