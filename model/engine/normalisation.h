// Group normalisation: from sums over a feature map to one affine function a channel.
#pragma once

#include <span>
#include <vector>

#include "model/engine/kernels.h"
#include "model/engine/weights.h"

namespace lightstage::model {

// Parameters of one layer, by channel.
struct NormPreluWeights {
  std::vector<float> scale, shift, slope;
};
// Those named LAYER.norm.scale, LAYER.norm.shift and LAYER.slope.
NormPreluWeights norm_prelu_weights(const SuperresWeights& weights, const std::string& layer);

// prelu(scale (x - mean) / sqrt(variance + 1e-5) + shift) as gain x + offset and slope, by block; mean and variance over groups of 8
// channels, or of 4 where 8 does not divide their number. `parts` holds, for each pair of blocks in turn, the moments of `parts_per_pair`
// parts of the map, merged in this order in float64. Channels that fill up a block become 0.
std::vector<BlockAffine> group_norm(std::span<const Moments> parts, std::size_t parts_per_pair,
                                    const NormPreluWeights& weights);

}  // namespace lightstage::model
