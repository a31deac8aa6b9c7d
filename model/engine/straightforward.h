// The published network as one writes it in libtorch without a further thought: memory row by row, torch's own group norm, PReLU and
// transposed convolution, everything computed for every query. What the engine and the training module are measured against, and an
// independent second statement of the network for their tests.
#pragma once

#include <torch/torch.h>

#include <map>
#include <string>
#include <vector>

#include "model/net/network.h"

namespace lightstage::model {

class StraightforwardSuperres {
 public:
  // Copies of the network's parameters, which require gradients.
  explicit StraightforwardSuperres(const Network& network);

  std::vector<torch::Tensor> parameters() const;
  // As Network::predict: the picture of the query, [1, 3, h, w], from the images of the active set, [k, 3, h, w].
  torch::Tensor predict(const torch::Tensor& images, const ActiveSet& set) const;

 private:
  const torch::Tensor& tensor(const std::string& name) const { return tensors_.at(name); }
  torch::Tensor norm_prelu(const torch::Tensor& x, const std::string& layer, std::int64_t groups) const;

  NetworkConfig config_;
  std::map<std::string, torch::Tensor> tensors_;
};

}  // namespace lightstage::model
