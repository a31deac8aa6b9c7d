#include "model/net/blend_network.h"

#include <algorithm>
#include <cmath>
#include <vector>

#include "model/net/layers.h"
#include "model/net/norm_prelu.h"

namespace lightstage::model {
namespace {

using torch::Tensor;

constexpr double kFirstLogit = -4;
// The residual learns about as fast as the rest where its values count this much.
constexpr double kResidualScale = 0.2;
// Keeps the square root differentiable where all neighbours agree.
constexpr double kLeastVariance = 1e-4;
// About the middle of what training showed; measured with docs/model.md's figures for large pictures.
constexpr double kSubjectPixels = 224;

// Where each light stands relative to the query, in light spacings and axes of the stage, and where the query is: [k, 8]. In the axes of the stage
// and not of the query's tangent plane, because pictures are taken in those axes (a light that moves to the right moves a shadow
// to the left wherever it stands), and because no choice of tangent axes is continuous all over the sphere.
Tensor place(const ActiveSet& set) {
  const std::int64_t k = set.weights.size(0);
  return torch::cat({set.offsets, double(k) * set.weights.unsqueeze(1), set.offsets.square().sum(1, true),
                     set.query.unsqueeze(0).expand({k, 3})},
                    1);
}

Tensor per_image(const Tensor& place, const Tensor& weight) {
  return torch::matmul(place, weight.t()).unsqueeze(2).unsqueeze(3);
}

// Weighted mean and standard deviation over the active set: [1, 2 channels, h, w]. A maximum would tell as much, but a light that enters the
// set with weight 0 could win it.
Tensor mean_and_spread(const Tensor& features, const Tensor& weights) {
  const Tensor mean = weighted_sum(features, weights);
  const Tensor variance = weighted_sum((features - mean).square(), weights);
  return torch::cat({mean, torch::sqrt(variance + kLeastVariance)}, 1);
}

}  // namespace

BlendNetwork::BlendNetwork(const NetworkConfig& config, std::uint64_t seed) : Network(config, seed) {
  const torch::NoGradGuard no_gradients;
  Tensor(parameter("head.logit.weight")).zero_();
  Tensor(parameter("head.logit.bias")).fill_(kFirstLogit);
  Tensor(parameter("residual.conv.weight")).zero_();
}

int BlendNetwork::coarseness(int longest_side) {
  return std::max(1, int(std::lround(double(longest_side) / kSubjectPixels)));
}

BlendNetwork::Correction BlendNetwork::correction(const Tensor& images, const Tensor& guide,
                                                  const ActiveSet& set) const {
  const Tensor difference = images - guide;
  const Tensor where = place(set);

  std::vector<Tensor> pooled;
  Tensor finest, x = torch::cat({images, difference}, 1);
  for (std::size_t level = 0; level < config().channels.size(); ++level) {
    const std::string name = "encoder." + std::to_string(level);
    x = conv3x3(x, parameter(name + ".conv.weight"), parameter(name + ".conv.bias"), level == 0 ? 1 : 2);
    if (level == 0) {
      x = channel_prelu(x + per_image(where, parameter(name + ".place.weight")), parameter(name + ".slope"));
      finest = x;
    } else {
      x = norm_prelu(x, parameter(name + ".norm.scale"), parameter(name + ".norm.shift"), parameter(name + ".slope"),
                     norm_groups(x.size(1)));
    }
    pooled.push_back(mean_and_spread(x, set.weights));
  }

  x = pooled.back();
  for (std::size_t level = pooled.size() - 1; level-- > 0;) {
    const std::string name = "decoder." + std::to_string(level);
    // To four times the channels and from those to twice the size: a transposed convolution at the speed of a convolution.
    x = conv3x3(x, parameter(name + ".conv.weight"), parameter(name + ".conv.bias"));
    x = channel_prelu(torch::pixel_shuffle(x, 2), parameter(name + ".slope"));
    x = torch::cat({x, pooled[level]}, 1);
  }
  const Tensor seen = channel_prelu(conv3x3(guide, parameter("guide.conv.weight"), parameter("guide.conv.bias")),
                                    parameter("guide.slope"));
  x = channel_prelu(conv3x3(torch::cat({x, seen}, 1), parameter("join.conv.weight"), parameter("join.conv.bias")),
                    parameter("join.slope"));

  Tensor hidden = torch::conv2d(channels_last(torch::cat({finest, difference}, 1)), parameter("head.neighbour.weight"));
  hidden = hidden + torch::conv2d(x, parameter("head.joined.weight"), parameter("head.joined.bias")) +
           per_image(where, parameter("head.place.weight"));
  hidden = channel_prelu(hidden, parameter("head.slope"));
  const Tensor logits = torch::conv2d(hidden, parameter("head.logit.weight"), parameter("head.logit.bias"));
  return {kLogitBound * torch::tanh(logits / kLogitBound),
          kResidualScale * conv3x3(x, parameter("residual.conv.weight"), parameter("residual.conv.bias"))};
}

Tensor BlendNetwork::predict(const Tensor& images, const Tensor& guide, const ActiveSet& set, int coarseness) const {
  const auto seen = [&](const Tensor& pictures) {
    const Tensor limited = pictures.clamp_max(kBrightestInput);
    return channels_last(coarseness == 1 ? limited : torch::avg_pool2d(limited, coarseness));
  };
  Correction c = correction(seen(images), seen(guide), set);
  if (coarseness > 1) {
    for (Tensor* tensor : {&c.logits, &c.residual}) {
      *tensor = torch::upsample_bilinear2d(*tensor, {images.size(2), images.size(3)}, /*align_corners=*/false);
    }
  }
  const Tensor weights = double(set.weights.size(0)) * set.weights.view({-1, 1, 1, 1});
  const Tensor share = weights * torch::exp(c.logits);
  return guide + (share * (images - guide)).sum(0, true) / (1 + share.sum(0, true)) + c.residual;
}

}  // namespace lightstage::model
