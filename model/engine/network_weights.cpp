#include <torch/torch.h>

#include "model/engine/network_weights.h"

namespace lightstage::model {

NetworkWeights::NetworkWeights(const Network& network) : config_(network.config()) {
  for (const auto& [name, tensor] : network.parameters()) tensors_[name] = tensor.detach().contiguous();
}

SuperresWeights NetworkWeights::view() const {
  return {config_.neighbours, config_.channels, config_.query_channels, float(Network::kBrightestInput),
          [this](const std::string& name) {
            const torch::Tensor& tensor = tensors_.at(name);
            return std::span<const float>(tensor.data_ptr<float>(), std::size_t(tensor.numel()));
          }};
}

}  // namespace lightstage::model
