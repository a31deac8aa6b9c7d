#include "model/net/meka_network.h"

#include "model/net/layers.h"
#include "model/net/u_net.h"

namespace lightstage::model {

using torch::Tensor;

Tensor MekaNetwork::predict(const Tensor& images, const Tensor&, const ActiveSet& set) const {
  const std::int64_t height = images.size(2), width = images.size(3);
  const Tensor gradients = images.clamp_max(kBrightestInput).reshape({1, -1, height, width});
  const Tensor query = spread(set.query, 1, height, width);
  return u_net_picture(*this, u_net_first_level(*this, torch::cat({gradients, query}, 1)));
}

}  // namespace lightstage::model
