#include "model/net/training_loss.h"

#include <algorithm>
#include <numeric>
#include <vector>

#include "model/net/layers.h"
#include "model/net/light_selection.h"
#include "model/net/progressive.h"
#include "model/net/superres_network.h"
#include "model/net/xu_network.h"

namespace lightstage::model {
namespace {

using torch::Tensor;

constexpr double kSquaredWeight = 4, kCrowdingWeight = 0.1;

ActiveSet whole_active_set(const Network& network, const Example& example) {
  std::vector<std::size_t> all(example.lights.size());
  std::iota(all.begin(), all.end(), std::size_t(0));
  return network.active_set(example.query, example.lights, all, example.spacing);
}

Tensor masked_mean(const Tensor& values, const Tensor& mask) {
  return (values * mask).sum() / (3 * mask.sum());
}

// For all but superres, which is trained as published.
Loss with_squares(const Tensor& picture, const Example& example) {
  const Tensor l1 = masked_l1(picture, example);
  return {l1 + kSquaredWeight * masked_mean((picture - example.truth).square(), example.mask), l1};
}

}  // namespace

Tensor predict(const Network& network, const Example& example) {
  if (const auto* xu = dynamic_cast<const XuNetwork*>(&network)) {
    const ActiveSet set =
        xu->active_set(example.query, example.stage.lights, xu->select(example.stage.lights), example.spacing);
    return xu->predict(example.stage.pictures(set.lights), {}, set);
  }
  if (network.config().architecture == Architecture::kMeka) {
    return network.predict(example.gradients, {}, network.active_set(example.query, {}, {}, example.spacing));
  }
  return network.predict(example.images, example.guide, whole_active_set(network, example));
}

Tensor masked_l1(const Tensor& picture, const Example& example) {
  return masked_mean((picture - example.truth).abs(), example.mask);
}

Loss training_loss(const Network& network, const Example& example) {
  const Tensor picture = predict(network, example);
  if (network.config().architecture != Architecture::kSuperres) return with_squares(picture, example);
  const Tensor l1 = masked_l1(picture, example);
  return {l1, l1};
}

Loss selection_loss(const Network& network, const Example& example, double sharpness) {
  const auto& xu = dynamic_cast<const XuNetwork&>(network);
  const std::vector<core::Direction>& lights = example.stage.lights;
  // Lights that are nearest to no candidate are in no mixture.
  std::vector<std::size_t> used = nearest_to_candidates(lights);
  std::sort(used.begin(), used.end());
  used.erase(std::unique(used.begin(), used.end()), used.end());
  const Tensor rows = torch::tensor(std::vector<std::int64_t>(used.begin(), used.end()));
  const Tensor shares = xu.shares(lights, sharpness).index_select(1, rows);

  const Example coarse = averaged_down(example, kSelectionLevel);
  const Tensor pictures = torch::avg_pool2d(example.stage.pictures(used), std::int64_t(1) << kSelectionLevel);
  const ActiveSet set = xu.active_set(example.query, lights, used, example.spacing);
  const auto mixtures = std::int64_t(shares.size(0));
  const Tensor images = torch::matmul(shares, pictures.reshape({pictures.size(0), -1}))
                            .view({mixtures, 3, pictures.size(2), pictures.size(3)});
  Loss loss = with_squares(xu.picture(images, torch::matmul(shares, set.directions), set.query), coarse);
  loss.value = loss.value + kCrowdingWeight * torch::relu(shares.sum(0) - 1).square().sum();
  return loss;
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
  coarse.guide = coarse.gradients = Tensor();
  coarse.stage = {};
  if (level == 0) return coarse;
  for (Tensor* tensor : {&coarse.images, &coarse.truth, &coarse.mask}) {
    *tensor = channels_last(torch::avg_pool2d(*tensor, std::int64_t(1) << level));
  }
  return coarse;
}

}  // namespace lightstage::model
