// The encoder and decoder with connections between equal sizes that `xu`, `xu_adaptive` and `meka` draw pictures with (Ronneberger et al. 2015, "U-Net:
// convolutional networks for biomedical image segmentation"; docs/model.md draws it).
#pragma once

#include <torch/torch.h>

#include "model/net/network.h"

namespace lightstage::model {

// What the fully connected layers query.0, query.1, ... make of a direction [3]: [1, channels]. They normalise across all their channels: on a
// map of one pixel instance norm is 0 / 0.
torch::Tensor query_features(const Network& network, const torch::Tensor& query);

// encoder.0 of n inputs at full size, [n, channels_0, h, w]: a convolution and PReLU, without norm.
torch::Tensor u_net_first_level(const Network& network, const torch::Tensor& inputs);

// The picture, [1, 3, h, w] in (0, 1), from the first level's features [1, channels_0, h, w]: all other levels. `at_the_bottom` [1, channels], if
// defined, joins the features of the coarsest level, the same at every pixel.
torch::Tensor u_net_picture(const Network& network, const torch::Tensor& first_level,
                            const torch::Tensor& at_the_bottom = {});

}  // namespace lightstage::model
