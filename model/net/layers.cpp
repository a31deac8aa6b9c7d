#include "model/net/layers.h"

namespace lightstage::model {

using torch::Tensor;

Tensor channels_last(const Tensor& x) {
  return x.contiguous(at::MemoryFormat::ChannelsLast);
}

Tensor conv3x3(const Tensor& x, const Tensor& weight, const Tensor& bias, int stride) {
  return torch::conv2d(channels_last(x), weight, bias, stride, 1);
}

int norm_groups(std::int64_t channels) {
  return int(channels % 8 == 0 ? channels / 8 : channels / 4);
}

Tensor weighted_sum(const Tensor& x, const Tensor& weights) {
  const std::int64_t n = x.size(0), c = x.size(1), h = x.size(2), w = x.size(3);
  // One product with the images as rows of memory.
  const Tensor rows = channels_last(x).permute({0, 2, 3, 1}).reshape({n, h * w * c});
  return torch::matmul(weights.unsqueeze(0), rows).view({1, h, w, c}).permute({0, 3, 1, 2});
}

Tensor spread(const Tensor& per_channel, std::int64_t n, std::int64_t h, std::int64_t w) {
  return per_channel.view({-1, per_channel.size(-1), 1, 1}).expand({n, per_channel.size(-1), h, w});
}

}  // namespace lightstage::model
