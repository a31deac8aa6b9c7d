// What the trainer, the checkpoint and the interpolators need of a network, whichever it is. All tensors are float32; images are
// display-encoded, [n, 3, h, w] in channels_last memory.
#pragma once

#include <torch/torch.h>

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "core/direction.h"
#include "model/checkpoint.h"

namespace lightstage::model {

// The k captured lights that a query is made of.
struct ActiveSet {
  std::vector<std::size_t> lights;  // indices into the scan
  torch::Tensor weights;            // [k], W_i, alias-free or all 1/k
  torch::Tensor directions;         // [k, 3], l_i
  torch::Tensor offsets;            // [k, 3], (l_i - q) / light spacing, in the axes of the stage
  torch::Tensor query;              // [3], q
};

class Network {
 public:
  using Parameters = std::vector<std::pair<std::string, torch::Tensor>>;

  virtual ~Network() = default;

  const NetworkConfig& config() const { return config_; }
  // By name, in the order of network_tensors. The tensors are the network's own: writing to one changes it.
  const Parameters& parameters() const { return parameters_; }
  const torch::Tensor& parameter(const std::string& name) const;

  // Heights and widths must be multiples of this.
  virtual int size_multiple() const = 0;
  // The same in training, which may look at smaller pictures.
  virtual int training_size_multiple() const { return size_multiple(); }

  // `active` indexes `lights`; `spacing` is that of the scan, in radians. The weights are differentiable in log_sharpness.
  ActiveSet active_set(const core::Direction& query, std::span<const core::Direction> lights,
                       std::vector<std::size_t> active, double spacing) const;

  // The picture of the query, [1, 3, h, w], from the images of the active set in its order, [k, 3, h, w], and the guide, the picture of
  // the query by thin-plate interpolation over all lights, [1, 3, h, w]. Continuous in the query with alias-free pooling.
  virtual torch::Tensor predict(const torch::Tensor& images, const torch::Tensor& guide,
                                const ActiveSet& set) const = 0;

  // A network sees images limited to this, so that one hot pixel does not drown the statistics of a picture.
  static constexpr double kBrightestInput = 2;

 protected:
  // Weights at random (He et al. 2015), the same for a seed; norms, slopes and biases at the values at which they do nothing.
  Network(const NetworkConfig& config, std::uint64_t seed);

 private:
  NetworkConfig config_;
  Parameters parameters_;
};

// The network of this configuration, untrained.
std::unique_ptr<Network> make_network(const NetworkConfig& config, std::uint64_t seed);

}  // namespace lightstage::model
