#include "model/net/network.h"

#include <ATen/CPUGeneratorImpl.h>

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "model/alias_free_weights.h"
#include "model/net/norm_prelu.h"

namespace lightstage::model {
namespace {

using torch::Tensor;

// Noise of a display-encoded value, squared and summed over the channels: differences below it say nothing.
constexpr double kNoiseVariance = 3e-4;
// The two logit terms that have one weight each learn as fast as the rest where their weights count this much.
constexpr double kTiltScale = 8;
constexpr double kTiltLimit = 3;
constexpr double kLogSharpnessLimit = 30;

Tensor channels_last(const Tensor& x) {
  return x.contiguous(at::MemoryFormat::ChannelsLast);
}

int norm_groups(std::int64_t channels) {
  return int(channels % 8 == 0 ? channels / 8 : channels / 4);
}

Tensor initial_value(const TensorInfo& info, double sharpness, at::Generator& generator) {
  if (info.name == "log_sharpness") return torch::tensor(float(std::log(sharpness)));
  if (info.name.ends_with(".slope")) return torch::full(info.shape, 0.25f);
  if (info.name.ends_with(".norm.scale")) return torch::ones(info.shape);
  if (!info.name.ends_with(".weight") || info.name == "head.logit.weight") return torch::zeros(info.shape);
  double fan_in = 1;
  for (std::size_t i = 1; i < info.shape.size(); ++i) fan_in *= double(info.shape[i]);
  // He et al. 2015, "Delving deep into rectifiers", equation 15, for a slope of 0.25 and a uniform distribution.
  const double bound = std::sqrt(3 * 2 / ((1 + 0.25 * 0.25) * fan_in));
  const Tensor value = (torch::rand(info.shape, generator) * 2 - 1) * bound;
  return value.dim() == 4 ? channels_last(value) : value;
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

// sum_i w_i x_i over the first dimension, [1, c, h, w], as one product with the images as rows of memory.
Tensor weighted_sum(const Tensor& x, const Tensor& weights) {
  const std::int64_t n = x.size(0), c = x.size(1), h = x.size(2), w = x.size(3);
  const Tensor rows = channels_last(x).permute({0, 2, 3, 1}).reshape({n, h * w * c});
  return torch::matmul(weights.unsqueeze(0), rows).view({1, h, w, c}).permute({0, 3, 1, 2});
}

Tensor spread(const Tensor& per_channel, std::int64_t n, std::int64_t h, std::int64_t w) {
  return per_channel.view({-1, per_channel.size(-1), 1, 1}).expand({n, per_channel.size(-1), h, w});
}

Tensor conv3x3(const Tensor& x, const Tensor& weight, const Tensor& bias, int stride = 1) {
  return torch::conv2d(channels_last(x), weight, bias, stride, 1);
}

// Where each light stands relative to the query, and how the set as a whole lies about it: [k, 7]. Like everything that is summed over
// the set, the mean offset is weighted by W_i.
Tensor geometry(const ActiveSet& set) {
  const std::int64_t k = set.weights.size(0);
  const Tensor weights = set.weights.unsqueeze(1);
  const Tensor mean = (weights * set.offsets).sum(0, true);
  return torch::cat({set.offsets, 4 * weights, set.offsets.square().sum(1, true), (set.offsets * mean).sum(1, true),
                     mean.square().sum(1, true).expand({k, 1})},
                    1);
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
  const Tensor& log_sharpness = parameter("log_sharpness");
  // Limited, so that a training run that leaves every bound ends in a loss that is not finite and not here.
  const double limited = std::clamp(double(log_sharpness.item<float>()), -kLogSharpnessLimit, kLogSharpnessLimit);
  const double s = std::exp(limited) / (spacing * spacing);
  const SlopedWeights w = sloped_alias_free_weights(query, directions, s);

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
  set.weights = to_tensor(w.weights);
  // The value is exactly W, since the last factor is 0; the derivative by ln s is W's.
  if (at::GradMode::is_enabled()) {
    set.weights = set.weights + to_tensor(w.slopes) * (log_sharpness - log_sharpness.detach());
  }
  return set;
}

Pyramid Network::encode(const Tensor& images, const Tensor& directions) const {
  const Tensor light = spread(directions, images.size(0), images.size(2), images.size(3));
  Tensor x = torch::cat({images.clamp_max(kBrightestInput), light}, 1);
  Pyramid pyramid;
  for (std::size_t level = 0; level < config_.channels.size(); ++level) {
    const std::string name = "encoder." + std::to_string(level);
    x = conv3x3(x, parameter(name + ".conv.weight"), parameter(name + ".conv.bias"), level == 0 ? 1 : 2);
    x = level == 0 ? channel_prelu(x, parameter(name + ".slope"))
                   : norm_prelu(x, parameter(name + ".norm.scale"), parameter(name + ".norm.shift"),
                                parameter(name + ".slope"), norm_groups(x.size(1)));
    pyramid.push_back(x);
  }
  return pyramid;
}

Tensor Network::decode(const Pyramid& pooled, const Tensor& guide_difference, const Tensor& query) const {
  const Tensor& coarsest = pooled.back();
  Tensor x = torch::cat({coarsest, spread(query, 1, coarsest.size(2), coarsest.size(3))}, 1);
  for (int level = int(pooled.size()) - 2; level >= 0; --level) {
    const std::string name = "decoder." + std::to_string(level);
    // To four times the channels and from those to twice the size: a transposed convolution at the speed of a convolution.
    x = conv3x3(x, parameter(name + ".conv.weight"), parameter(name + ".conv.bias"));
    x = channel_prelu(torch::pixel_shuffle(x, 2), parameter(name + ".slope"));
    x = torch::cat({x, pooled[std::size_t(level)]}, 1);
  }
  x = torch::cat({x, guide_difference}, 1);
  x = conv3x3(x, parameter("decoder.join.conv.weight"), parameter("decoder.join.conv.bias"));
  return channel_prelu(x, parameter("decoder.join.slope"));
}

Tensor Network::logits(const Pyramid& features, const Tensor& images, const Tensor& guide, const ActiveSet& set) const {
  Pyramid pooled;
  for (const Tensor& level : features) pooled.push_back(weighted_sum(level, set.weights));

  const Tensor limited = images.clamp_max(kBrightestInput);
  const Tensor mean = weighted_sum(limited, set.weights);
  const Tensor guide_difference = channels_last(guide.clamp_max(kBrightestInput) - mean);
  const Tensor decoded = decode(pooled, guide_difference, set.query);

  // How far an image leans from the mean towards the guide: with logits t_i the blend is, to first order, the point nearest to the
  // guide on a line through the mean, since sum_i W_i t_i (I_i - mean) has the length of the guide's difference where the set's
  // images differ along it.
  const Tensor difference = channels_last(limited - mean);
  const Tensor weight = set.weights.view({-1, 1, 1, 1});
  const Tensor variance = (weight * difference.square().sum(1, true)).sum(0, true);
  const Tensor lean =
      ((difference * guide_difference).sum(1, true) / (variance + kNoiseVariance)).clamp(-kTiltLimit, kTiltLimit);

  const Tensor place = geometry(set);
  Tensor x = torch::conv2d(channels_last(torch::cat({features.front(), difference, lean}, 1)),
                           parameter("head.neighbour.weight"));
  x = x + torch::conv2d(decoded, parameter("head.decoded.weight"), parameter("head.decoded.bias"));
  x = x + torch::matmul(place, parameter("head.geometry.weight").t()).unsqueeze(2).unsqueeze(3);
  x = channel_prelu(x, parameter("head.slope"));

  const Tensor& tilt = parameter("head.tilt");
  const Tensor toward_centre = place.select(1, 5).view({-1, 1, 1, 1});
  const Tensor logit =
      torch::conv2d(x, parameter("head.logit.weight")) + kTiltScale * (tilt[0] * lean + tilt[1] * toward_centre);
  return kLogitBound * torch::tanh(logit / kLogitBound);
}

Tensor blend(const Tensor& images, const Tensor& weights, const Tensor& logits) {
  const Tensor share = weights.view({-1, 1, 1, 1}) * torch::exp(logits);
  return (share * images).sum(0, true) / share.sum(0, true);
}

}  // namespace lightstage::model
