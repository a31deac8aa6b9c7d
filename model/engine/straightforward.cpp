#include "model/engine/straightforward.h"

#include <torch/torch.h>

namespace lightstage::model {

using torch::Tensor;

namespace {

std::int64_t groups(std::int64_t channels) {
  return channels % 8 == 0 ? channels / 8 : channels / 4;
}

}  // namespace

StraightforwardSuperres::StraightforwardSuperres(const Network& network) : config_(network.config()) {
  for (const auto& [name, value] : network.parameters()) {
    tensors_[name] = value.detach().clone(at::MemoryFormat::Contiguous).set_requires_grad(true);
  }
}

std::vector<Tensor> StraightforwardSuperres::parameters() const {
  std::vector<Tensor> all;
  for (const auto& [name, value] : tensors_) all.push_back(value);
  return all;
}

Tensor StraightforwardSuperres::norm_prelu(const Tensor& x, const std::string& layer, std::int64_t group_count) const {
  const Tensor normalised =
      torch::group_norm(x, group_count, tensor(layer + ".norm.scale"), tensor(layer + ".norm.shift"), 1e-5);
  return torch::prelu(normalised, tensor(layer + ".slope"));
}

Tensor StraightforwardSuperres::predict(const Tensor& images, const ActiveSet& set) const {
  const std::int64_t k = images.size(0);
  const Tensor limited = images.clamp_max(Network::kBrightestInput).contiguous();
  const Tensor light = set.directions.view({k, 3, 1, 1}).expand({k, 3, images.size(2), images.size(3)});
  Tensor x = torch::cat({limited, light}, 1);
  const Tensor weights = set.weights.view({k, 1, 1, 1});
  std::vector<Tensor> pooled;
  for (std::size_t level = 0; level < config_.channels.size(); ++level) {
    const std::string name = "encoder." + std::to_string(level);
    x = torch::conv2d(x, tensor(name + ".conv.weight"), tensor(name + ".conv.bias"), /*stride=*/2, /*padding=*/1);
    x = norm_prelu(x, name, groups(x.size(1)));
    pooled.push_back((x * weights).sum(0, /*keepdim=*/true));
  }

  x = set.query.view({1, 3});
  for (std::size_t layer = 0; layer < config_.query_channels.size(); ++layer) {
    const std::string name = "query." + std::to_string(layer);
    x = norm_prelu(torch::linear(x, tensor(name + ".weight"), tensor(name + ".bias")), name, 1);
  }
  x = x.view({1, -1, 1, 1}).expand({1, x.size(1), pooled.back().size(2), pooled.back().size(3)});

  for (std::size_t level = config_.channels.size(); level-- > 0;) {
    const std::string name = "decoder." + std::to_string(level);
    x = torch::conv_transpose2d(torch::cat({x, pooled[level]}, 1), tensor(name + ".conv.weight"),
                                tensor(name + ".conv.bias"), /*stride=*/2, /*padding=*/1, /*output_padding=*/1);
    x = norm_prelu(x, name, groups(x.size(1)));
  }
  return torch::sigmoid(torch::conv2d(x, tensor("output.0.conv.weight"), tensor("output.0.conv.bias"), 1, 1));
}

}  // namespace lightstage::model
