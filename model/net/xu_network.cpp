#include "model/net/xu_network.h"

#include <ATen/CPUGeneratorImpl.h>

#include "model/net/layers.h"
#include "model/net/light_selection.h"
#include "model/net/u_net.h"

namespace lightstage::model {
namespace {

using torch::Tensor;

constexpr double kFirstLogits = 0.01;  // within +- this: enough to tell rows apart

// [n, 6, h, w]
Tensor with_directions(const Tensor& images, const Tensor& directions) {
  const Tensor light = spread(directions, images.size(0), images.size(2), images.size(3));
  return torch::cat({images.clamp_max(Network::kBrightestInput), light}, 1);
}

}  // namespace

XuNetwork::XuNetwork(const NetworkConfig& config, std::uint64_t seed) : Network(config, seed) {
  const torch::NoGradGuard no_gradients;
  at::Generator generator = at::detail::createCPUGenerator(seed);
  Tensor logits = parameter("sampling.logits");
  logits.copy_((torch::rand(logits.sizes(), generator) * 2 - 1) * kFirstLogits);
}

int XuNetwork::training_size_multiple() const {
  return size_multiple() << kSelectionLevel;
}

std::vector<std::size_t> XuNetwork::select(std::span<const core::Direction> lights) const {
  const Tensor logits = parameter("sampling.logits").detach().contiguous();
  const std::span values(logits.data_ptr<float>(), std::size_t(logits.numel()));
  return lights_for(chosen_candidates(values, std::size_t(logits.size(0))), lights);
}

Tensor XuNetwork::shares(std::span<const core::Direction> lights, double sharpness) const {
  const std::vector<std::size_t> nearest = nearest_to_candidates(lights);
  const Tensor columns = torch::tensor(std::vector<std::int64_t>(nearest.begin(), nearest.end()));
  const Tensor candidates = torch::softmax(sharpness * parameter("sampling.logits"), 1);
  return torch::zeros({candidates.size(0), std::int64_t(lights.size())}).index_add(1, columns, candidates);
}

Tensor XuNetwork::picture(const Tensor& images, const Tensor& directions, const Tensor& query) const {
  const Tensor pictures = with_directions(images, directions);
  const Tensor all = pictures.reshape({1, -1, images.size(2), images.size(3)});
  return u_net_picture(*this, u_net_first_level(*this, all), query_features(*this, query));
}

Tensor XuNetwork::predict(const Tensor& images, const Tensor&, const ActiveSet& set) const {
  return picture(images, set.directions, set.query);
}

Tensor XuAdaptiveNetwork::predict(const Tensor& images, const Tensor&, const ActiveSet& set) const {
  const Tensor features = u_net_first_level(*this, with_directions(images, set.directions));
  return u_net_picture(*this, weighted_sum(features, set.weights), query_features(*this, set.query));
}

}  // namespace lightstage::model
