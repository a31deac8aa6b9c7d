#include "model/net/u_net.h"

#include <string>
#include <vector>

#include "model/net/layers.h"
#include "model/net/norm_prelu.h"
#include "model/net/transposed_convolution.h"

namespace lightstage::model {

using torch::Tensor;

Tensor query_features(const Network& network, const Tensor& query) {
  Tensor x = query.view({1, 3});
  for (std::size_t layer = 0; layer < network.config().query_channels.size(); ++layer) {
    const std::string name = "query." + std::to_string(layer);
    x = torch::addmm(network.parameter(name + ".bias"), x, network.parameter(name + ".weight").t());
    x = norm_prelu(x.view({1, -1, 1, 1}), network.parameter(name + ".norm.scale"),
                   network.parameter(name + ".norm.shift"), network.parameter(name + ".slope"), /*groups=*/1)
            .view({1, -1});
  }
  return x;
}

Tensor u_net_first_level(const Network& network, const Tensor& inputs) {
  const Tensor x =
      conv3x3(inputs, network.parameter("encoder.0.conv.weight"), network.parameter("encoder.0.conv.bias"));
  return channel_prelu(x, network.parameter("encoder.0.slope"));
}

Tensor u_net_picture(const Network& network, const Tensor& first_level, const Tensor& at_the_bottom) {
  const auto normalised = [&](const std::string& name, const Tensor& x) {
    return norm_prelu(x, network.parameter(name + ".norm.scale"), network.parameter(name + ".norm.shift"),
                      network.parameter(name + ".slope"), norm_groups(x.size(1)));
  };
  std::vector<Tensor> encoded{first_level};
  for (std::size_t level = 1; level < network.config().channels.size(); ++level) {
    const std::string name = "encoder." + std::to_string(level);
    encoded.push_back(normalised(name, conv3x3(encoded.back(), network.parameter(name + ".conv.weight"),
                                               network.parameter(name + ".conv.bias"), 2)));
  }
  Tensor x = encoded.back();
  if (at_the_bottom.defined()) x = torch::cat({x, spread(at_the_bottom, 1, x.size(2), x.size(3))}, 1);
  for (std::size_t level = encoded.size() - 1; level-- > 0;) {
    const std::string name = "decoder." + std::to_string(level);
    x = normalised(name, doubling_convolution(x, network.parameter(name + ".conv.weight"),
                                              network.parameter(name + ".conv.bias")));
    x = torch::cat({x, encoded[level]}, 1);
  }
  x = channel_prelu(conv3x3(x, network.parameter("join.conv.weight"), network.parameter("join.conv.bias")),
                    network.parameter("join.slope"));
  return torch::sigmoid(conv3x3(x, network.parameter("output.conv.weight"), network.parameter("output.conv.bias")));
}

}  // namespace lightstage::model
