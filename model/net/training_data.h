// What a training step looks at: one captured light as query and truth, some of its neighbours, and a window of pixels.
#pragma once

#include <torch/torch.h>

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "core/olat_scan.h"
#include "model/net/network.h"
#include "model/net/pixels.h"
#include "model/training.h"

namespace lightstage::model {

struct Example {
  core::Direction query;
  std::span<const core::Direction> lights;  // of its scan
  double spacing = 0;                       // of its scan, radians
  std::vector<std::size_t> active;          // indices into lights
  torch::Tensor images;                     // [k, 3, h, w], of the active lights
  torch::Tensor guide;                      // [1, 3, h, w], thin-plate interpolation without the query's light
  torch::Tensor truth;                      // [1, 3, h, w]
  torch::Tensor mask;                       // [1, 1, h, w], 0 or 1
};

// One scan in memory: display-encoded, limited to what the network sees, around the mask. Takes 24 bytes a light and pixel.
class TrainingScan {
 public:
  // Sizes are rounded up to `multiple`; `candidates` is m. Throws UsageError when the scan has fewer than neighbours + 1 lights, or
  // all in one place.
  TrainingScan(const core::OlatScan& scan, int neighbours, int candidates, int multiple);

  // Lights that serve as truth in training, and others that serve as truth in validation only: about one in sixteen.
  const std::vector<std::size_t>& training_lights() const { return training_lights_; }
  const std::vector<std::size_t>& validation_lights() const { return validation_lights_; }
  // The lights nearest to a light, at most m of them, nearest first: neither itself nor others in its place.
  const std::vector<std::size_t>& candidates(std::size_t light) const { return candidates_[light]; }

  // `size` pixels square, or less where the scan is smaller, around the masked pixel whose number is `anchor` modulo their number.
  Window window_around(std::uint64_t anchor, int size) const;
  Example example(std::size_t light, std::vector<std::size_t> active, const Window& window) const;

 private:
  void load(const core::OlatScan& scan, const Window& mask_window, int multiple);
  void choose_neighbours(int candidates);
  void interpolate_guides();

  std::vector<core::Direction> directions_;
  double spacing_ = 0;
  std::vector<std::size_t> training_lights_, validation_lights_;
  std::vector<std::vector<std::size_t>> apart_;  // by light: all lights in other places, nearest first
  std::vector<std::vector<std::size_t>> candidates_;
  std::vector<std::pair<int, int>> masked_pixels_;  // (y, x)
  torch::Tensor displays_, guides_;                 // [lights, 3, h, w]
  torch::Tensor mask_;                              // [1, h, w]
};

// The scans of a training run, and the draws from them. Draw number n is the same for a seed whatever was drawn before, so that a resumed
// run needs to know only how far it had come.
class TrainingData {
 public:
  TrainingData(std::span<const core::OlatScan> scans, const TrainOptions& options, int multiple);

  Example training_draw(std::int64_t number) const;
  // Validation lights from their nearest neighbours; `number` counts from 0 to validation_count() - 1.
  Example validation_draw(int number) const;
  int validation_count() const;

 private:
  std::vector<TrainingScan> scans_;
  std::uint64_t seed_;
  int neighbours_;
  int crop_;
};

}  // namespace lightstage::model
