#include "model/net/training_loss.h"

#include <numeric>
#include <vector>

#include "model/net/layers.h"
#include "model/net/progressive.h"
#include "model/net/superres_network.h"

namespace lightstage::model {
namespace {

using torch::Tensor;

constexpr double kSquaredWeight = 4;

ActiveSet whole_active_set(const Network& network, const Example& example) {
  std::vector<std::size_t> all(example.lights.size());
  std::iota(all.begin(), all.end(), std::size_t(0));
  return network.active_set(example.query, example.lights, all, example.spacing);
}

Tensor masked_mean(const Tensor& values, const Tensor& mask) {
  return (values * mask).sum() / (3 * mask.sum());
}

}  // namespace

Tensor predict(const Network& network, const Example& example) {
  return network.predict(example.images, example.guide, whole_active_set(network, example));
}

Tensor masked_l1(const Tensor& picture, const Example& example) {
  return masked_mean((picture - example.truth).abs(), example.mask);
}

Loss training_loss(const Network& network, const Example& example) {
  const Tensor picture = predict(network, example);
  const Tensor l1 = masked_l1(picture, example);
  if (network.config().architecture != Architecture::kBlend) return {l1, l1};
  return {l1 + kSquaredWeight * masked_mean((picture - example.truth).square(), example.mask), l1};
}

Loss progressive_loss(const Network& network, const Example& example, double position) {
  const auto& superres = dynamic_cast<const SuperresNetwork&>(network);
  const ActiveSet set = whole_active_set(network, example);
  Tensor sum;
  for (const auto& [level, weight] : active_levels(position)) {
    const Example coarse = averaged_down(example, level);
    const Tensor loss = weight * masked_l1(superres.predict_at(coarse.images, set, level), coarse);
    sum = sum.defined() ? sum + loss : loss;
  }
  return {sum, sum};
}

Example averaged_down(const Example& example, int level) {
  Example coarse = example;
  coarse.guide = Tensor();
  if (level == 0) return coarse;
  for (Tensor* tensor : {&coarse.images, &coarse.truth, &coarse.mask}) {
    *tensor = channels_last(torch::avg_pool2d(*tensor, std::int64_t(1) << level));
  }
  return coarse;
}

}  // namespace lightstage::model
