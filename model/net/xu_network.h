// Pictures from k captured ones at a time (Xu et al. 2018, "Deep image-based relighting from optimal sparse samples"; docs/model.md draws it).
#pragma once

#include <vector>

#include "model/net/network.h"

namespace lightstage::model {

// From the k lights that it chose in training, whatever the query: "images" and "set" are those of select(), in that order, and the weights of the set
// do not count. The query enters at the bottom of the encoder, so the picture is continuous in it.
class XuNetwork : public Network {
 public:
  // The logits of the choice are all but equal at first.
  XuNetwork(const NetworkConfig& config, std::uint64_t seed);

  int size_multiple() const override { return 1 << (config().channels.size() - 1); }
  int training_size_multiple() const override;

  // Its lights among these, all different where there are that many (model/net/light_selection.h).
  std::vector<std::size_t> select(std::span<const core::Direction> lights) const;
  // How much of each light makes each picture, [k, lights], rows that sum to 1: the softmax of `sharpness` times the logits. Differentiable.
  torch::Tensor shares(std::span<const core::Direction> lights, double sharpness) const;

  torch::Tensor predict(const torch::Tensor& images, const torch::Tensor& guide, const ActiveSet& set) const override;
  // From [k, 3, h, w] and [k, 3] of images and directions, or mixtures of them.
  torch::Tensor picture(const torch::Tensor& images, const torch::Tensor& directions, const torch::Tensor& query) const;
};

// The variant that is given the k lights nearest to the query. Their number stays and their places in the list do not, so the first level of
// the encoder, with the same weights for every light, makes features of one light at a time, and the features are pooled with the alias-free weights: a
// light enters and leaves with weight 0, and the picture is continuous in the query. As published it would take the pictures as a list, and jump.
class XuAdaptiveNetwork : public Network {
 public:
  XuAdaptiveNetwork(const NetworkConfig& config, std::uint64_t seed) : Network(config, seed) {}

  int size_multiple() const override { return 1 << (config().channels.size() - 1); }

  torch::Tensor predict(const torch::Tensor& images, const torch::Tensor& guide, const ActiveSet& set) const override;
};

}  // namespace lightstage::model
