// What a training step looks at: a query with its truth, the captured pictures around it, and a window of pixels.
#pragma once

#include <torch/torch.h>

#include <cstdint>
#include <functional>
#include <memory>
#include <span>
#include <vector>

#include "core/olat_scan.h"
#include "model/training.h"

namespace lightstage::model {

// For networks that choose among the lights of a stage.
struct CapturedStage {
  std::vector<core::Direction> lights;  // in other places than the query's
  // [n, 3, h, w], of some of them; to be asked for while the data is there.
  std::function<torch::Tensor(const std::vector<std::size_t>& lights)> pictures;
};

struct Example {
  core::Direction query;
  std::vector<core::Direction> lights;  // the active set, k of them
  double spacing = 0;                   // of the scan, radians
  torch::Tensor images;                 // [k, 3, h, w], of the active set
  torch::Tensor guide;                  // [1, 3, h, w], thin-plate interpolation over all lights but the query's
  torch::Tensor truth;                  // [1, 3, h, w]
  torch::Tensor mask;                   // [1, 1, h, w], 0 or 1
  CapturedStage stage;                  // not with thinned active sets
  torch::Tensor gradients;  // [2, 3, h, w], model/colour_gradients.h without the query's own light; for meka only
};

// Draw number n is the same for a seed whatever was drawn before, so that a resumed run needs to know only how far it had come.
class TrainingData {
 public:
  virtual ~TrainingData() = default;

  virtual Example training_draw(std::int64_t number) = 0;
  // `number` counts from 0 to validation_count() - 1; nothing of these is in a training draw.
  virtual Example validation_draw(int number) = 0;
  virtual int validation_count() const = 0;
};

// Query and truth are one captured light, the active set some of its nearest neighbours (Sun et al. 2020, section 4.4). Throws UsageError when a scan
// has fewer than neighbours + 1 lights, or all in one place. Windows are multiples of `multiple`.
std::unique_ptr<TrainingData> captured_data(std::span<const core::OlatScan> scans, const TrainOptions& options,
                                            int multiple);

// Queries where no light stands, with the truth that a simulator knows; the active set are the nearest lights. Views are made when they are
// first needed, one every few steps, and kept.
std::unique_ptr<TrainingData> simulated_data(const SimulatedViews& views, const TrainOptions& options, int multiple);

}  // namespace lightstage::model
