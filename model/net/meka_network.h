// The picture of one light from two spherical colour gradients (Meka et al. 2019, "Deep reflectance fields: high-quality facial reflectance field
// inference from color gradient illumination"; docs/model.md draws it). The publication's perceptual loss, which needs a network of its own, is left
// out.
#pragma once

#include "model/net/network.h"

namespace lightstage::model {

class MekaNetwork : public Network {
 public:
  MekaNetwork(const NetworkConfig& config, std::uint64_t seed) : Network(config, seed) {}

  int size_multiple() const override { return 1 << (config().channels.size() - 1); }

  // `images` are the two gradients of model/colour_gradients.h, display-encoded, [2, 3, h, w]; of `set` only the query counts, which every
  // pixel is told. Continuous in the query.
  torch::Tensor predict(const torch::Tensor& images, const torch::Tensor& guide, const ActiveSet& set) const override;
};

}  // namespace lightstage::model
