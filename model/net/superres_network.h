// The published network (Sun et al. 2020, "Light Stage Super-Resolution", section 4; docs/model.md draws it): what
// training differentiates, and the reference for faster engines.
//
// Where the publication leaves a choice open: group norm has groups of 8 channels; the transposed convolution doubles sizes exactly (padding 1,
// output padding 1); the layers on the query's direction normalise across all their channels, since on a map of one pixel instance norm is
// 0 / 0; the finest level decodes to C_0 channels at full size, from which a 3x3 convolution makes the colours; the alias-free weights' s is
// relative to the squared light spacing.
#pragma once

#include <vector>

#include "model/net/network.h"

namespace lightstage::model {

// Features of n images: level l is [n, channels_l, h / 2^(l+1), w / 2^(l+1)].
using Pyramid = std::vector<torch::Tensor>;

class SuperresNetwork : public Network {
 public:
  SuperresNetwork(const NetworkConfig& config, std::uint64_t seed);

  int size_multiple() const override { return 1 << config().channels.size(); }

  // Encodes n images, each with the direction of its own light ([n, 3]): nothing of a query enters. Images averaged down to 1 / 2^first_level of the size
  // enter there: inject.l stands for what the encoder makes of a full-size image above it. The pyramid then begins with level `first_level`.
  Pyramid encode(const torch::Tensor& images, const torch::Tensor& directions, int first_level = 0) const;
  // One set of features a level, [1, channels_l, ...].
  Pyramid pool(const Pyramid& features, const ActiveSet& set) const;
  // The picture, [1, 3, h, w], in (0, 1), from all levels or from those that begin with `last_level`: then at 1 / 2^last_level of the size.
  torch::Tensor decode(const Pyramid& pooled, const torch::Tensor& query, int last_level = 0) const;

  // encode, pool, decode; the guide is not looked at.
  torch::Tensor predict(const torch::Tensor& images, const torch::Tensor& guide, const ActiveSet& set) const override;
  // The picture at 1 / 2^level of the size from images averaged down to it, for progressive training.
  torch::Tensor predict_at(const torch::Tensor& images, const ActiveSet& set, int level) const;

  int levels() const { return int(config().channels.size()); }
};

}  // namespace lightstage::model
