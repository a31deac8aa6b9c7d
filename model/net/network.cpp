#include "model/net/network.h"

#include <ATen/CPUGeneratorImpl.h>

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "model/alias_free_weights.h"
#include "model/net/blend_network.h"
#include "model/net/meka_network.h"
#include "model/net/superres_network.h"
#include "model/net/xu_network.h"

namespace lightstage::model {
namespace {

using torch::Tensor;

constexpr double kLogSharpnessLimit = 30;

Tensor initial_value(const TensorInfo& info, double sharpness, at::Generator& generator) {
  if (info.name == "log_sharpness") return torch::tensor(float(std::log(sharpness)));
  if (info.name.ends_with(".slope")) return torch::full(info.shape, 0.25f);
  if (info.name.ends_with(".norm.scale")) return torch::ones(info.shape);
  if (!info.name.ends_with(".weight")) return torch::zeros(info.shape);
  double fan_in = 1;
  for (std::size_t i = 1; i < info.shape.size(); ++i) fan_in *= double(info.shape[i]);
  // He et al. 2015, "Delving deep into rectifiers", equation 15, for a slope of 0.25 and a uniform distribution.
  const double bound = std::sqrt(3 * 2 / ((1 + 0.25 * 0.25) * fan_in));
  const Tensor value = (torch::rand(info.shape, generator) * 2 - 1) * bound;
  return value.dim() == 4 ? value.contiguous(at::MemoryFormat::ChannelsLast) : value;
}

Tensor to_tensor(std::span<const core::Direction> directions) {
  Tensor result = torch::empty({std::int64_t(directions.size()), 3});
  float* out = result.data_ptr<float>();
  for (const core::Direction& d : directions) {
    *out++ = float(d.x());
    *out++ = float(d.y());
    *out++ = float(d.z());
  }
  return result;
}

Tensor to_tensor(const std::vector<double>& values) {
  return torch::tensor(values).to(torch::kFloat32);
}

}  // namespace

Network::Network(const NetworkConfig& config, std::uint64_t seed) : config_(config) {
  at::Generator generator = at::detail::createCPUGenerator(seed);
  for (const TensorInfo& info : network_tensors(config)) {
    parameters_.emplace_back(info.name, initial_value(info, config.sharpness, generator).set_requires_grad(true));
  }
}

const Tensor& Network::parameter(const std::string& name) const {
  const auto found =
      std::find_if(parameters_.begin(), parameters_.end(), [&](const auto& entry) { return entry.first == name; });
  if (found == parameters_.end()) throw std::logic_error("the network has no tensor '" + name + "'");
  return found->second;
}

ActiveSet Network::active_set(const core::Direction& query, std::span<const core::Direction> lights,
                              std::vector<std::size_t> active, double spacing) const {
  std::vector<core::Direction> directions;
  for (const std::size_t index : active) directions.push_back(lights[index]);

  ActiveSet set;
  set.lights = std::move(active);
  set.directions = to_tensor(directions);
  set.query = to_tensor(std::span(&query, 1))[0];
  // Differences of float64 directions: in float32 those of near lights would lose half their digits.
  std::vector<double> offsets;
  for (const core::Direction& light : directions) {
    const core::Vec3 offset = (light.vec() - query.vec()) / spacing;
    offsets.insert(offsets.end(), {offset.x, offset.y, offset.z});
  }
  set.offsets = to_tensor(offsets).view({-1, 3});

  const auto k = std::int64_t(directions.size());
  if (config_.pooling == Pooling::kAverage || !has_sharpness(config_.architecture)) {
    set.weights = torch::full({k}, 1 / float(k));
    return set;
  }
  const Tensor& log_sharpness = parameter("log_sharpness");
  // Limited, so that a training run that leaves every bound ends in a loss that is not finite and not here.
  const double limited = std::clamp(double(log_sharpness.item<float>()), -kLogSharpnessLimit, kLogSharpnessLimit);
  const SlopedWeights w = sloped_alias_free_weights(query, directions, std::exp(limited) / (spacing * spacing));
  set.weights = to_tensor(w.weights);
  // The value is exactly W, since the last factor is 0; the derivative by ln s is W's.
  if (at::GradMode::is_enabled()) {
    set.weights = set.weights + to_tensor(w.slopes) * (log_sharpness - log_sharpness.detach());
  }
  return set;
}

std::unique_ptr<Network> make_network(const NetworkConfig& config, std::uint64_t seed) {
  switch (config.architecture) {
    case Architecture::kSuperres:
      return std::make_unique<SuperresNetwork>(config, seed);
    case Architecture::kBlend:
      return std::make_unique<BlendNetwork>(config, seed);
    case Architecture::kXu:
      return std::make_unique<XuNetwork>(config, seed);
    case Architecture::kXuAdaptive:
      return std::make_unique<XuAdaptiveNetwork>(config, seed);
    case Architecture::kMeka:
      break;
  }
  return std::make_unique<MekaNetwork>(config, seed);
}

}  // namespace lightstage::model
