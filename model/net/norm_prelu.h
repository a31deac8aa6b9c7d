// Group normalisation and PReLU in one pass over memory. Taken one after the other they cost more time than the convolutions between them.
#pragma once

#include <torch/torch.h>

namespace lightstage::model {

// y = prelu(scale * (x - mean) / sqrt(variance + 1e-5) + shift): mean and variance over each group of consecutive channels of each image
// (Wu and He 2018, "Group normalization"), prelu(z) = z where z > 0 and slope * z elsewhere, scale, shift and slope one a channel.
// x is [n, channels, h, w] in channels_last memory (anything else is copied), and so is the result; channels must be divisible by
// `groups`. Sums are taken in float64 over fixed blocks, so that results do not depend on the thread count. Differentiable in all four
// tensors.
torch::Tensor norm_prelu(const torch::Tensor& x, const torch::Tensor& scale, const torch::Tensor& shift,
                         const torch::Tensor& slope, int groups);

// y = prelu(x), likewise.
torch::Tensor channel_prelu(const torch::Tensor& x, const torch::Tensor& slope);

}  // namespace lightstage::model
