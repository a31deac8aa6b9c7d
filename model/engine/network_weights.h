// From the network that is trained to the engine that uses it.
#pragma once

#include <torch/torch.h>

#include <map>
#include <string>

#include "model/engine/weights.h"
#include "model/net/network.h"

namespace lightstage::model {

// Row-major copies of a superres network's parameters, which the engine packs in its own order when it is made.
class NetworkWeights {
 public:
  explicit NetworkWeights(const Network& network);

  // Refers to this.
  SuperresWeights view() const;

 private:
  NetworkConfig config_;
  std::map<std::string, torch::Tensor> tensors_;
};

}  // namespace lightstage::model
