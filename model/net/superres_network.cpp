#include "model/net/superres_network.h"

#include "model/net/layers.h"
#include "model/net/norm_prelu.h"
#include "model/net/transposed_convolution.h"
#include "model/net/u_net.h"

namespace lightstage::model {

using torch::Tensor;

SuperresNetwork::SuperresNetwork(const NetworkConfig& config, std::uint64_t seed) : Network(config, seed) {}

Pyramid SuperresNetwork::encode(const Tensor& images, const Tensor& directions, int first_level) const {
  const Tensor light = spread(directions, images.size(0), images.size(2), images.size(3));
  Tensor x = torch::cat({images.clamp_max(kBrightestInput), light}, 1);
  if (first_level > 0) {
    const std::string name = "inject." + std::to_string(first_level);
    x = torch::conv2d(channels_last(x), parameter(name + ".conv.weight"), parameter(name + ".conv.bias"));
    x = channel_prelu(x, parameter(name + ".slope"));
  }
  Pyramid pyramid;
  for (int level = first_level; level < levels(); ++level) {
    const std::string name = "encoder." + std::to_string(level);
    x = conv3x3(x, parameter(name + ".conv.weight"), parameter(name + ".conv.bias"), 2);
    x = norm_prelu(x, parameter(name + ".norm.scale"), parameter(name + ".norm.shift"), parameter(name + ".slope"),
                   norm_groups(x.size(1)));
    pyramid.push_back(x);
  }
  return pyramid;
}

Pyramid SuperresNetwork::pool(const Pyramid& features, const ActiveSet& set) const {
  Pyramid pooled;
  for (const Tensor& level : features) pooled.push_back(weighted_sum(level, set.weights));
  return pooled;
}

Tensor SuperresNetwork::decode(const Pyramid& pooled, const Tensor& query, int last_level) const {
  const Tensor& coarsest = pooled.back();
  Tensor x = spread(query_features(*this, query), 1, coarsest.size(2), coarsest.size(3));
  for (std::size_t i = pooled.size(); i-- > 0;) {
    const std::string name = "decoder." + std::to_string(i + std::size_t(last_level));
    x = doubling_convolution(torch::cat({x, pooled[i]}, 1), parameter(name + ".conv.weight"),
                             parameter(name + ".conv.bias"));
    x = norm_prelu(x, parameter(name + ".norm.scale"), parameter(name + ".norm.shift"), parameter(name + ".slope"),
                   norm_groups(x.size(1)));
  }
  const std::string name = "output." + std::to_string(last_level);
  return torch::sigmoid(conv3x3(x, parameter(name + ".conv.weight"), parameter(name + ".conv.bias")));
}

Tensor SuperresNetwork::predict(const Tensor& images, const Tensor&, const ActiveSet& set) const {
  return predict_at(images, set, 0);
}

Tensor SuperresNetwork::predict_at(const Tensor& images, const ActiveSet& set, int level) const {
  return decode(pool(encode(images, set.directions, level), set), set.query, level);
}

}  // namespace lightstage::model
