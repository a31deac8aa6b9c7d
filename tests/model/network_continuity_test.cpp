// Networks as functions of the query: continuous where the active set changes, and finite with finite gradients at every extreme.
#include <catch2/catch.hpp>

// torch brings a CHECK of its own, which ends the program.
#pragma push_macro("CHECK")
#include <ATen/CPUGeneratorImpl.h>
#include <torch/torch.h>
#pragma pop_macro("CHECK")

#include <limits>
#include <numbers>

#include "core/sphere.h"
#include "model/classical/radial_basis.h"
#include "model/net/network.h"
#include "model/net/superres_network.h"
#include "model/net/training_loss.h"

namespace lightstage {
namespace {

using core::Direction;
using core::Vec3;
using model::Architecture;
using torch::Tensor;

// A network with random numbers wherever one starts at 0 or 1, so that every part of it counts.
std::unique_ptr<model::Network> lively_network(const model::NetworkConfig& config, std::uint64_t seed = 3) {
  std::unique_ptr<model::Network> network = model::make_network(config, seed);
  const torch::NoGradGuard no_gradients;
  at::Generator generator = at::detail::createCPUGenerator(seed + 100);
  for (const auto& [name, parameter] : network->parameters()) {
    if (name == "log_sharpness") continue;
    Tensor values = parameter;
    values.add_(torch::randn(values.sizes(), generator), name.ends_with(".weight") ? 0.05 : 0.2);
  }
  return network;
}

model::NetworkConfig with_pooling(model::NetworkConfig config, model::Pooling pooling) {
  config.pooling = pooling;
  return config;
}

// A stage, and a picture a light in which every light differs.
struct Stage {
  std::vector<Direction> lights;
  double spacing;
  Tensor pictures;  // [lights, 3, 16, 16]
  model::RadialBasisWeights interpolation;

  explicit Stage(std::size_t count)
      : lights(core::fibonacci_directions(count)),
        spacing(core::median_spacing_radians(lights)),
        pictures(torch::empty({std::int64_t(count), 3, 16, 16})),
        interpolation(lights) {
    at::Generator generator = at::detail::createCPUGenerator(8);
    pictures = torch::rand(pictures.sizes(), generator).contiguous(at::MemoryFormat::ChannelsLast);
  }

  Tensor picture(const model::Network& network, const Direction& query, std::vector<std::size_t> active) const {
    const std::vector<std::int64_t> rows(active.begin(), active.end());
    const std::vector<double> w = interpolation(query);
    const Tensor guide = (torch::tensor(w).to(torch::kFloat32).view({-1, 1, 1, 1}) * pictures).sum(0, true);
    return network.predict(pictures.index_select(0, torch::tensor(rows)), guide,
                           network.active_set(query, lights, std::move(active), spacing));
  }

  Tensor picture(const model::Network& network, const Direction& query) const {
    return picture(network, query, core::nearest_indices(lights, query, std::size_t(network.config().neighbours)));
  }
};

// The point at an angle along the great circle through two directions.
struct GreatCircle {
  Vec3 start, across;

  GreatCircle(const Direction& a, const Direction& b) : start(a.vec()) {
    across = Direction::from_vector(b.vec() - dot(a.vec(), b.vec()) * a.vec()).vec();
  }
  Direction operator()(double angle) const {
    return Direction::from_vector(std::cos(angle) * start + std::sin(angle) * across);
  }
};

// Angles at which the set of the k nearest lights changes, to 1e-9, of every n-th change.
std::vector<double> changes(const GreatCircle& circle, const std::vector<Direction>& lights, std::size_t k, int every) {
  const auto set_at = [&](double angle) {
    auto set = core::nearest_indices(lights, circle(angle), k);
    std::sort(set.begin(), set.end());
    return set;
  };
  constexpr double kStep = 0.01;
  std::vector<double> result;
  int seen = 0;
  for (double angle = 0; angle < 2 * std::numbers::pi; angle += kStep) {
    const auto first = set_at(angle);
    if (set_at(angle + kStep) == first || seen++ % every != 0) continue;
    double before = angle, after = angle + kStep;
    while (after - before > 1e-9) {
      const double middle = (before + after) / 2;
      (set_at(middle) == first ? before : after) = middle;
    }
    result.push_back((before + after) / 2);
  }
  return result;
}

double largest(const Tensor& a) {
  return a.abs().max().item<double>();
}

// The largest change of the picture when the query moves by `step` across changes of its active set.
double largest_jump(const model::Network& network, const Stage& stage, double step) {
  const torch::NoGradGuard no_gradients;
  const std::vector<Direction> ends = core::random_directions(6, 17);
  double jump = 0;
  int crossed = 0;
  for (std::size_t i = 0; i < ends.size(); i += 2) {
    const GreatCircle circle(ends[i], ends[i + 1]);
    for (const double at : changes(circle, stage.lights, std::size_t(network.config().neighbours), 8)) {
      const Tensor before = stage.picture(network, circle(at - step / 2));
      const Tensor after = stage.picture(network, circle(at + step / 2));
      jump = std::max(jump, largest(after - before));
      ++crossed;
    }
  }
  REQUIRE(crossed >= 15);
  return jump;
}

// All that look at an active set.
std::vector<model::NetworkConfig> pooling_networks() {
  return {model::network_preset("tiny"),
          model::network_preset("blend"),
          {.architecture = Architecture::kXuAdaptive, .channels = {8, 12, 16}, .query_channels = {8, 16}}};
}

// Small ones, where it is the number of cases that counts.
std::vector<model::NetworkConfig> small_networks() {
  return {{.neighbours = 8, .channels = {8, 12}, .query_channels = {8, 16}},
          {.architecture = Architecture::kBlend, .neighbours = 8, .channels = {8, 12}},
          {.architecture = Architecture::kXuAdaptive, .neighbours = 8, .channels = {8, 12}, .query_channels = {8}}};
}

void require_finite_gradients(const model::Network& network) {
  for (const auto& [name, parameter] : network.parameters()) {
    INFO(name);
    // Heads of coarse levels have none here.
    if (parameter.grad().defined()) CHECK(torch::isfinite(parameter.grad()).all().item<bool>());
  }
}

}  // namespace

TEST_CASE("where the active set changes, an alias-free network's picture moves no more than its query") {
  const Stage stage(60);
  constexpr double kNoise = 1e-5;  // float32, through the whole network
  for (const model::NetworkConfig& config : pooling_networks()) {
    INFO(model::architecture_name(config.architecture));
    const auto network = lively_network(config);
    const double wide = largest_jump(*network, stage, 1e-2);
    const double middle = largest_jump(*network, stage, 1e-3);
    const double narrow = largest_jump(*network, stage, 1e-4);
    const double none = largest_jump(*network, stage, 1e-7);
    INFO(wide << " " << middle << " " << narrow << " " << none);
    CHECK(wide > 1e-2);  // the query does matter
    // A tenth of the step, about a tenth of the change.
    CHECK(middle < wide / 4);
    CHECK(narrow < middle / 4 + kNoise);
    CHECK(none < kNoise);
  }
}

TEST_CASE("average pooling jumps where the active set changes, however small the step") {
  const Stage stage(60);
  const auto average = lively_network(with_pooling(model::network_preset("tiny"), model::Pooling::kAverage));
  const auto alias_free = lively_network(model::network_preset("tiny"));
  const double wide = largest_jump(*average, stage, 1e-2), none = largest_jump(*average, stage, 1e-7);
  INFO(wide << " " << none);
  CHECK(none > wide / 2);
  CHECK(none > 100 * largest_jump(*alias_free, stage, 1e-7));
}

TEST_CASE("a network trained at a coarse level sees and makes pictures of that size, and the finest level is predict") {
  const model::NetworkConfig config{.channels = {8, 12, 16}, .query_channels = {8}};
  const model::SuperresNetwork network(config, 5);
  const Stage stage(20);
  model::Example example;
  example.query = Direction::from_vector({0.2, 0.3, 1});
  example.lights.assign(stage.lights.begin(), stage.lights.begin() + 8);
  example.spacing = stage.spacing;
  example.images = stage.pictures.narrow(0, 0, 8);
  example.truth = stage.pictures.narrow(0, 9, 1);
  example.mask = torch::zeros({1, 1, 16, 16});
  example.mask.narrow(3, 0, 3).fill_(1);

  const std::vector<std::size_t> all{0, 1, 2, 3, 4, 5, 6, 7};
  const model::ActiveSet set = network.active_set(example.query, example.lights, all, example.spacing);
  for (int level = 0; level < 3; ++level) {
    const model::Example coarse = model::averaged_down(example, level);
    const std::int64_t size = 16 >> level, block = std::int64_t(1) << level;
    REQUIRE(coarse.images.sizes().vec() == std::vector<std::int64_t>{8, 3, size, size});
    const Tensor first = example.truth.narrow(2, 0, block).narrow(3, 0, block).mean({2, 3});
    CHECK(largest(coarse.truth.select(3, 0).select(2, 0) - first) < 1e-6);
    CHECK(coarse.mask.sum().item<double>() * double(block * block) == Approx(3 * 16));
    const Tensor picture = network.predict_at(coarse.images, set, level);
    CHECK(picture.sizes().vec() == std::vector<std::int64_t>{1, 3, size, size});
    if (level == 0) CHECK(torch::equal(picture, network.predict(example.images, {}, set)));
    // At one level only, the loss of that level.
    const double expected = model::masked_l1(picture, coarse).item<double>();
    CHECK(model::progressive_loss(network, example, level).value.item<double>() == Approx(expected));
  }
  const auto loss_at = [&](double position) {
    return model::progressive_loss(network, example, position).value.item<double>();
  };
  CHECK(loss_at(1.25) == Approx(0.75 * loss_at(1) + 0.25 * loss_at(2)));
}

TEST_CASE("the masked error looks at nothing outside the mask") {
  model::Example example;
  example.truth = torch::zeros({1, 3, 4, 4});
  example.mask = torch::zeros({1, 1, 4, 4});
  example.mask.narrow(2, 0, 1).fill_(1);
  Tensor picture = torch::full({1, 3, 4, 4}, 100.0f);
  picture.narrow(2, 0, 1).fill_(-0.25);
  CHECK(model::masked_l1(picture, example).item<double>() == Approx(0.25));
}

TEST_CASE("gradients are finite for every geometry and sharpness") {
  const Stage stage(60);
  const std::vector<Direction>& lights = stage.lights;
  const Direction between = Direction::from_vector(lights[7].vec() + lights[8].vec());
  const Direction opposite = Direction::from_vector(-lights[7].vec());
  const auto near = [&](const Direction& query) { return core::nearest_indices(lights, query, 8); };

  Stage ring = stage;  // all equally far from the pole
  for (std::size_t i = 0; i < 8; ++i) {
    ring.lights[i] = Direction::from_longitude_latitude_degrees(45.0 * double(i), 40);
  }
  const Direction pole = Direction::from_vector({0, 1, 0});
  Stage hole = stage;  // nothing within 40 degrees
  for (std::size_t i = 0; i < 8; ++i) {
    hole.lights[i] = Direction::from_longitude_latitude_degrees(45.0 * double(i), 50.0 - double(i));
  }
  struct Case {
    const Stage& stage;
    Direction query;
    std::vector<std::size_t> active;
  };
  const std::vector<std::size_t> first_eight{0, 1, 2, 3, 4, 5, 6, 7};
  const std::vector<Case> cases{{stage, lights[7], near(lights[7])}, {stage, between, near(between)},
                                {stage, opposite, near(lights[7])},  {ring, pole, first_eight},
                                {hole, pole, first_eight},           {stage, between, {7, 7, 7}},
                                {stage, lights[7], {7, 7, 20, 20}},  {stage, between, {7}}};
  for (const model::NetworkConfig& config : small_networks()) {
    for (const auto& [place, query, active] : cases) {
      // s from (nearly) 0 to 1e6 in the formula, and beyond what it can be.
      for (const double s : {1e-30, 1e-6, 1.0, 100.0, 1e6, 1e30}) {
        const auto network = lively_network(config);
        {
          const torch::NoGradGuard no_gradients;
          Tensor(network->parameter("log_sharpness")).fill_(std::log(s * place.spacing * place.spacing));
        }
        const Tensor picture = place.picture(*network, query, active);
        CHECK(torch::isfinite(picture).all().item<bool>());
        picture.square().mean().backward();
        require_finite_gradients(*network);
      }
    }
  }
}

TEST_CASE("the gradient of the sharpness is that of the picture") {
  const Stage stage(60);
  const Direction query = Direction::from_vector({0.3, 0.1, 1});
  for (const model::NetworkConfig& config : small_networks()) {
    const auto network = lively_network(config);
    const Tensor log_sharpness = network->parameter("log_sharpness");
    const auto loss = [&] { return stage.picture(*network, query).square().mean(); };
    loss().backward();
    const double gradient = log_sharpness.grad().item<double>();
    const torch::NoGradGuard no_gradients;
    const double middle = log_sharpness.item<double>(), step = 0.02;
    Tensor(log_sharpness).fill_(middle + step);
    const double above = loss().item<double>();
    Tensor(log_sharpness).fill_(middle - step);
    const double below = loss().item<double>();
    CHECK(std::abs(gradient) > 1e-5);
    CHECK(gradient == Approx((above - below) / (2 * step)).epsilon(0.05).margin(2e-5));  // float32 in a difference
  }
}

TEST_CASE("extreme pictures give finite pictures and gradients") {
  const Stage stage(20);
  const std::vector<std::size_t> active = core::nearest_indices(stage.lights, stage.lights[3], 8);
  const Direction query = Direction::from_vector(stage.lights[3].vec() + 0.3 * stage.lights[4].vec());
  std::vector<std::pair<const char*, Tensor>> extremes{{"black", torch::zeros_like(stage.pictures)}};
  for (const double level : {65504.0, 1e5, 1e30, double(std::numeric_limits<float>::denorm_min()), 1e-30}) {
    extremes.emplace_back("everywhere the same", torch::full_like(stage.pictures, level));
    Tensor one = stage.pictures.clone();
    one.select(3, 5).select(2, 6).fill_(level);
    extremes.emplace_back("one pixel", one);
    Tensor alone = torch::zeros_like(stage.pictures);
    alone.select(3, 5).select(2, 6).fill_(level);
    extremes.emplace_back("one pixel in the dark", alone);
  }
  for (const model::NetworkConfig& config : small_networks()) {
    for (const auto& [name, pictures] : extremes) {
      INFO(name);
      Stage extreme = stage;
      extreme.pictures = pictures;
      const auto network = lively_network(config);
      const Tensor picture = extreme.picture(*network, query, active);
      CHECK(torch::isfinite(picture).all().item<bool>());
      // As training sees it, which limits what it is shown.
      extreme.pictures = pictures.clamp_max(model::Network::kBrightestInput);
      extreme.picture(*network, query, active).abs().mean().backward();
      require_finite_gradients(*network);
    }
  }
}

}  // namespace lightstage
