// The super-resolution network in torch: encoder, alias-free pooling, decoder and blending head (Sun et al. 2020, section 4; docs/model.md
// draws it and says where it differs). All tensors are float32; images are display-encoded, [n, channels, h, w] in channels_last memory.
#pragma once

#include <torch/torch.h>

#include <cstddef>
#include <cstdint>
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
  torch::Tensor weights;            // [k], alias-free W_i
  torch::Tensor directions;         // [k, 3], l_i
  torch::Tensor offsets;            // [k, 3], (l_i - q) / light spacing
  torch::Tensor query;              // [3], q
};

// Features of n images: level l is [n, channels_l, h / 2^l, w / 2^l].
using Pyramid = std::vector<torch::Tensor>;

class Network {
 public:
  // Weights at random (He et al. 2015), the same for a seed; the head at zero, so that logits are 0 everywhere.
  Network(const NetworkConfig& config, std::uint64_t seed);

  const NetworkConfig& config() const { return config_; }
  // By name, in the order of network_tensors. The tensors are the network's own: writing to one changes it.
  const std::vector<std::pair<std::string, torch::Tensor>>& parameters() const { return parameters_; }
  const torch::Tensor& parameter(const std::string& name) const;

  // Heights and widths must be multiples of this.
  int size_multiple() const { return 1 << (config_.channels.size() - 1); }

  // `active` indexes `lights`; `spacing` is that of the scan, in radians. The weights are differentiable in log_sharpness.
  ActiveSet active_set(const core::Direction& query, std::span<const core::Direction> lights,
                       std::vector<std::size_t> active, double spacing) const;

  // Encodes n images, each with the direction of its own light ([n, 3]): nothing of a query enters.
  Pyramid encode(const torch::Tensor& images, const torch::Tensor& directions) const;

  // One logit a pixel of every active image, [k, 1, h, w], within +-kLogitBound. `features` and `images` are those of the active
  // set in its order; `guide` ([1, 3, h, w]) is another method's picture of the query, of which only the difference to the linear
  // blend is looked at. Continuous in the query where the active set changes, because everything that sums over the set is
  // weighted by W_i, which is 0 for a light that enters or leaves.
  torch::Tensor logits(const Pyramid& features, const torch::Tensor& images, const torch::Tensor& guide,
                       const ActiveSet& set) const;

  static constexpr double kLogitBound = 6;
  // The encoder sees images limited to this, so that one hot pixel does not drown the statistics of a picture; what is blended is not.
  static constexpr double kBrightestInput = 2;

 private:
  torch::Tensor decode(const Pyramid& pooled, const torch::Tensor& guide_difference, const torch::Tensor& query) const;

  NetworkConfig config_;
  std::vector<std::pair<std::string, torch::Tensor>> parameters_;
};

// sum_i W_i exp(g_i) I_i / sum_j W_j exp(g_j), [1, c, h, w], for images [k, c, h, w], weights [k], and logits [k, 1, h, w].
torch::Tensor blend(const torch::Tensor& images, const torch::Tensor& weights, const torch::Tensor& logits);

}  // namespace lightstage::model
