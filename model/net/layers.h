// The few operations that both networks are built of. Tensors are [n, channels, h, w] in channels_last memory.
#pragma once

#include <torch/torch.h>

#include <cstdint>

namespace lightstage::model {

torch::Tensor channels_last(const torch::Tensor& x);

// 3x3, one pixel of zeros around.
torch::Tensor conv3x3(const torch::Tensor& x, const torch::Tensor& weight, const torch::Tensor& bias, int stride = 1);

// Groups of 8 channels, or of 4 where 8 does not divide.
int norm_groups(std::int64_t channels);

// sum_i w_i x_i over the first dimension, [1, c, h, w], for w of shape [n].
torch::Tensor weighted_sum(const torch::Tensor& x, const torch::Tensor& weights);

// [channels] or [n, channels], the same at every pixel, as a view.
torch::Tensor spread(const torch::Tensor& per_channel, std::int64_t n, std::int64_t h, std::int64_t w);

}  // namespace lightstage::model
