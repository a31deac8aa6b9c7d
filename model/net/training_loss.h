// What a training step makes small.
#pragma once

#include <torch/torch.h>

#include "model/net/network.h"
#include "model/net/training_data.h"

namespace lightstage::model {

// The network's picture of an example: from its whole active set; in xu from the lights it chooses, in meka from the gradients.
torch::Tensor predict(const Network& network, const Example& example);

// Mean |picture - truth| over the values inside the mask, a scalar.
torch::Tensor masked_l1(const torch::Tensor& picture, const Example& example);

struct Loss {
  torch::Tensor value;  // to be differentiated
  torch::Tensor l1;     // the masked L1 in it
};

// Masked L1, for all but superres plus 4 times the masked squared error, of full-size pictures.
Loss training_loss(const Network& network, const Example& example);

// Masked L1 of superres at the levels active at this position (model/net/progressive.h), weighted.
Loss progressive_loss(const Network& network, const Example& example, double position);

// That of xu on pictures averaged down to 1 / 2^kSelectionLevel, from mixtures of all lights (XuNetwork::shares), plus a tenth of the square of how much of
// a light is in the mixtures above 1, which keeps two of them from ending in the same light.
Loss selection_loss(const Network& network, const Example& example, double sharpness);

// The example with pictures and mask averaged down to 1 / 2^level; sizes must divide. Pixels of the mask then count by the share of them inside. The
// guide, the stage and the gradients are left out.
Example averaged_down(const Example& example, int level);

}  // namespace lightstage::model
