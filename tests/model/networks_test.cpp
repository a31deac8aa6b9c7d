// The networks as functions: where they start, that they are continuous, and that every size and extreme gives a finite picture.
#include <catch2/catch.hpp>

// torch brings a CHECK of its own, which ends the program.
#pragma push_macro("CHECK")
#include <ATen/CPUGeneratorImpl.h>
#include <ATen/Parallel.h>
#include <torch/torch.h>
#pragma pop_macro("CHECK")

#include <limits>
#include <thread>

#include "core/display.h"
#include "core/parallel.h"
#include "core/sphere.h"
#include "model/classical.h"
#include "model/net/blend_network.h"
#include "model/net/network_file.h"
#include "model/net/norm_prelu.h"
#include "model/net/pixels.h"
#include "model/net/superres_network.h"
#include "model/net/training_data.h"
#include "model/network_interpolator.h"
#include "model/synthetic_scan.h"
#include "support/support.h"

namespace lightstage {
namespace {

using core::Direction;
using core::Image;
using core::ImageSize;
using model::Network;
using torch::Tensor;

const model::NetworkConfig kBlend{
    .architecture = model::Architecture::kBlend, .neighbours = 8, .channels = {4, 8, 12}, .sharpness = 4};
const model::NetworkConfig kSuperres{.neighbours = 8, .channels = {4, 8, 12}, .query_channels = {8, 12}};
const model::NetworkConfig kXu{
    .architecture = model::Architecture::kXu, .neighbours = 6, .channels = {4, 8, 12}, .query_channels = {8, 12}};
const model::NetworkConfig kXuAdaptive{
    .architecture = model::Architecture::kXuAdaptive, .channels = {4, 8, 12}, .query_channels = {8, 12}};
const model::NetworkConfig kMeka{.architecture = model::Architecture::kMeka, .neighbours = 2, .channels = {4, 8, 12}};

// Weights as training might leave them: nothing is zero any more.
std::unique_ptr<Network> trained_looking(const model::NetworkConfig& config) {
  std::unique_ptr<Network> network = model::make_network(config, 3);
  const torch::NoGradGuard no_gradients;
  at::Generator generator = at::detail::createCPUGenerator(11);
  for (auto [name, parameter] : network->parameters()) {
    if (name == "head.logit.weight") parameter.copy_(torch::randn(parameter.sizes(), generator));
    if (name == "head.logit.bias") parameter.zero_();
    if (name == "residual.conv.weight") parameter.copy_(0.1 * torch::randn(parameter.sizes(), generator));
  }
  return network;
}

// A scene with structure that differs from light to light, so that wrong blending shows.
core::OlatScan busy_scan(ImageSize size, std::size_t lights = 60, Image mask = {}) {
  const auto value = [size](const Direction& l, int y, int x, int c) {
    const double edge = std::sin(9.0 * y / size.height + 8 * l.x()) + std::cos(7.0 * x / size.width + 9 * l.y());
    return std::max(0.0, 0.4 * (l.z() + 1.2) + 0.3 * edge + 0.1 * c);
  };
  return test::scan_of(core::fibonacci_directions(lights), size, value, std::move(mask));
}

std::filesystem::path saved(const test::TemporaryFolder& folder, const Network& network) {
  model::save_network(folder / "net.safetensors", network, "{}");
  return folder / "net.safetensors";
}

double largest_difference(const Image& a, const Image& b) {
  REQUIRE(a.size() == b.size());
  double largest = 0;
  for (std::size_t i = 0; i < a.values().size(); ++i) {
    largest = std::max(largest, std::abs(double(a.values()[i]) - double(b.values()[i])));
  }
  return largest;
}

bool finite(const Image& image) {
  return std::all_of(image.values().begin(), image.values().end(), [](float v) { return std::isfinite(v); });
}

double largest(const Tensor& a) {
  return a.abs().max().item<double>();
}

}  // namespace

TEST_CASE("an untrained blend is close to thin-plate interpolation, a trained one is not") {
  const test::TemporaryFolder folder;
  const core::OlatScan scan = busy_scan({13, 17, 3});
  const auto rbf = model::make_rbf(scan, model::Domain::kDisplay);
  const auto difference = [&](const Network& network) {
    const auto interpolator = model::make_network_interpolator(scan, saved(folder, network));
    double largest_so_far = 0;
    for (const Direction& query : core::random_directions(6, 2)) {
      const Image a = core::display_encode(interpolator->render(query)), b = core::display_encode(rbf->render(query));
      largest_so_far = std::max(largest_so_far, largest_difference(a, b) / std::pow(scan.exposure(), 1 / 2.2));
    }
    return largest_so_far;
  };
  CHECK(difference(*model::make_network(kBlend, 1)) <
        0.03);  // neighbours have at most k e^-4 / (1 + k e^-4) of the picture
  CHECK(difference(*trained_looking(kBlend)) > 0.05);
}

TEST_CASE("the picture does not jump where the active set changes, as it would with plain average pooling") {
  const torch::NoGradGuard no_gradients;
  const core::OlatScan scan = busy_scan({8, 16, 3});
  const std::vector<Direction>& lights = scan.directions();
  const auto architecture = GENERATE(model::Architecture::kBlend, model::Architecture::kSuperres);
  const auto network = trained_looking(architecture == model::Architecture::kBlend ? kBlend : kSuperres);
  const auto rbf = model::make_rbf(scan, model::Domain::kDisplay);
  const double spacing = core::median_spacing_radians(lights);
  const auto picture = [&](const Direction& query, bool alias_free) {
    model::ActiveSet set = network->active_set(query, lights, core::nearest_indices(lights, query, 8), spacing);
    if (!alias_free) set.weights = torch::full_like(set.weights, 1.0 / 8);
    std::vector<Tensor> displays;
    for (const std::size_t i : set.lights) displays.push_back(model::to_display(*scan.image(i), 1));
    return network->predict(torch::stack(displays), model::to_display(rbf->render(query), 1).unsqueeze(0), set);
  };
  const auto along = [](double t) { return Direction::from_vector({std::cos(t), 0.5 * std::sin(2 * t), std::sin(t)}); };
  const auto set_at = [&](double t) {
    auto set = core::nearest_indices(lights, along(t), 8);
    std::sort(set.begin(), set.end());
    return set;
  };

  int changes = 0;
  double largest_jump = 0, largest_plain_jump = 0;
  for (double t = 0; t < 1.5; t += 0.02) {
    if (set_at(t) == set_at(t + 0.02)) continue;
    double before = t, after = t + 0.02;  // closes in on one change
    while (after - before > 1e-7) {
      const double middle = (before + after) / 2;
      (set_at(middle) == set_at(t) ? before : after) = middle;
    }
    ++changes;
    largest_jump = std::max(largest_jump, largest(picture(along(after), true) - picture(along(before), true)));
    largest_plain_jump =
        std::max(largest_plain_jump, largest(picture(along(after), false) - picture(along(before), false)));
  }
  REQUIRE(changes > 10);
  CHECK(largest_jump < 2e-4);  // 1e-7 radians of movement, and float32
  CHECK(largest_plain_jump > 100 * largest_jump);
}

TEST_CASE("every network's picture moves with the query and does not jump") {
  const test::TemporaryFolder folder;
  const core::OlatScan scan = busy_scan({8, 12, 3}, 40);
  const auto path = saved(folder, *trained_looking(GENERATE(kBlend, kSuperres, kXu, kXuAdaptive, kMeka)));
  const auto network = model::make_network_interpolator(scan, path);
  const auto picture = [&](double t) {
    return core::display_encode(
        network->render(Direction::from_vector({std::cos(t), 0.5 * std::sin(2 * t), std::sin(t)})));
  };
  // Steps a hundred times as small change a picture about a hundred times as little, wherever they are: sets of lights change on the way.
  double coarse = 0, fine = 0;
  for (double t = 0; t < 1.5; t += 0.05) {
    coarse = std::max(coarse, largest_difference(picture(t), picture(t + 0.01)));
    fine = std::max(fine, largest_difference(picture(t + 0.005), picture(t + 0.0051)));
  }
  CHECK(coarse > 1e-5);
  CHECK(fine < coarse / 10 + 2e-5);
}

TEST_CASE("pictures do not depend on threads or on what was asked before") {
  const test::TemporaryFolder folder;
  const core::OlatScan scan = busy_scan({37, 23, 3}, 40);
  const auto path = saved(folder, *trained_looking(GENERATE(kBlend, kSuperres, kXu, kXuAdaptive, kMeka)));
  const auto queries = core::random_directions(6, 9);
  const auto cached = model::make_network_interpolator(scan, path);
  std::vector<Image> expected;
  for (const Direction& query : queries) expected.push_back(cached->render(query));
  for (std::size_t i = queries.size(); i-- > 0;) CHECK(cached->render(queries[i]) == expected[i]);

  const auto shared = model::make_network_interpolator(scan, path);
  std::vector<Image> from_threads(queries.size());
  std::vector<std::thread> threads;
  for (std::size_t i = 0; i < queries.size(); ++i) {
    threads.emplace_back([&, i] { from_threads[i] = shared->render(queries[i]); });
  }
  for (std::thread& thread : threads) thread.join();
  for (std::size_t i = 0; i < queries.size(); ++i) CHECK(from_threads[i] == expected[i]);

  core::set_thread_count(1);
  const auto single = model::make_network_interpolator(scan, path);
  for (std::size_t i = 0; i < queries.size(); ++i)
    CHECK(largest_difference(single->render(queries[i]), expected[i]) < 1e-6);
  core::set_thread_count(0);
}

TEST_CASE("images of any size, any mask and any number of channels are rendered") {
  const test::TemporaryFolder folder;
  const auto path = saved(folder, *trained_looking(GENERATE(kBlend, kSuperres, kXu, kXuAdaptive, kMeka)));
  const Direction query = Direction::from_vector({0.2, 0.1, 1});
  for (const ImageSize size : {ImageSize{1, 1, 3}, {3, 41, 3}, {41, 3, 1}, {31, 29, 3}, {2, 2, 4}}) {
    const core::OlatScan scan = busy_scan(size, 20);
    const Image image = model::make_network_interpolator(scan, path)->render(query);
    CHECK((image.size() == ImageSize{size.height, size.width, size.channels == 1 ? 1 : 3}));
    CHECK(finite(image));
  }
  for (const std::size_t lights : {1, 2, 5}) {
    CHECK(finite(model::make_network_interpolator(busy_scan({5, 7, 3}, lights), path)->render(query)));
  }
  const core::OlatScan scan = busy_scan({5, 7, 3}, 20);
  for (const std::size_t light : {0, 11}) {
    CHECK(finite(model::make_network_interpolator(scan, path)->render(scan.directions()[light])));
  }
}

TEST_CASE(
    "outside the mask's bounding box the picture is a classical one, and a grey scan is a colour scan without "
    "colour") {
  const test::TemporaryFolder folder;
  const auto config = GENERATE(kBlend, kSuperres, kXu, kXuAdaptive, kMeka);
  const auto path = saved(folder, *trained_looking(config));
  Image mask(19, 23, 1);
  for (int y = 4; y < 9; ++y) {
    for (int x = 6; x < 17; ++x) mask(y, x) = 1;
  }
  const core::OlatScan scan = busy_scan({19, 23, 3}, 30, mask);
  const Direction query = Direction::from_vector({-0.3, 0.4, 1});
  const Image network = model::make_network_interpolator(scan, path)->render(query);
  const double spacing = core::median_spacing_radians(scan.directions());
  const double sharpness = (config == kSuperres ? config.sharpness : 2.0) / (spacing * spacing);
  const auto classical = config == kBlend ? model::make_rbf(scan, model::Domain::kDisplay)
                                          : model::make_linear_blend(scan, 8, sharpness, model::Domain::kDisplay);
  const Image expected = classical->render(query);
  double outside = 0, inside = 0;
  for (int y = 0; y < 19; ++y) {
    for (int x = 0; x < 23; ++x) {
      double& largest_here = mask(y, x) > 0 ? inside : outside;
      largest_here = std::max(largest_here, std::abs(double(network(y, x)) - expected(y, x)));
    }
  }
  CHECK(outside < 1e-5);
  CHECK(inside > 1e-2);

  const auto shade = [](const Direction& l, int y, int x, int) { return 0.5 + 0.3 * std::sin(y * l.x() + x * l.y()); };
  const auto lights = core::fibonacci_directions(30);
  const Image grey = model::make_network_interpolator(test::scan_of(lights, {9, 11, 1}, shade), path)->render(query);
  const Image colour = model::make_network_interpolator(test::scan_of(lights, {9, 11, 3}, shade), path)->render(query);
  // Networks may see colour where there is none; of a grey scan their mean is kept.
  for (int y = 0; y < 9; ++y) {
    for (int x = 0; x < 11; ++x) {
      const float mean = (colour(y, x, 0) + colour(y, x, 1) + colour(y, x, 2)) / 3;
      CHECK(grey(y, x) == Approx(mean).epsilon(1e-4));
    }
  }
}

TEST_CASE("extreme pictures give finite pictures") {
  const test::TemporaryFolder folder;
  const auto path = saved(folder, *trained_looking(GENERATE(kBlend, kSuperres, kXu, kXuAdaptive, kMeka)));
  const Direction query = Direction::from_vector({0.1, 0.3, 1});
  const ImageSize size{9, 10, 3};
  const auto lights = core::fibonacci_directions(20);
  const auto render = [&](const test::PixelFunction& value) {
    return model::make_network_interpolator(test::scan_of(lights, size, value), path)->render(query);
  };
  CHECK(finite(render([](const Direction&, int, int, int) { return 0.0; })));
  for (const double level : {65504.0, 1e30, 1e-30, double(std::numeric_limits<float>::denorm_min())}) {
    CHECK(finite(render([&](const Direction&, int, int, int) { return level; })));
    // One such pixel in an ordinary picture, and an ordinary pixel in a black one.
    CHECK(finite(
        render([&](const Direction& l, int y, int x, int) { return y == 4 && x == 4 ? level : 0.5 + 0.4 * l.x(); })));
    CHECK(finite(render([&](const Direction&, int y, int x, int) { return y == 4 && x == 4 ? level : 0.0; })));
  }
  CHECK(finite(render([](const Direction&, int, int, int) { return -1.0; })));
}

TEST_CASE("a large subject is looked at in the size of those in training") {
  for (const auto& [side, expected] : {std::pair(1, 1), {224, 1}, {335, 1}, {337, 2}, {760, 3}, {3000, 13}}) {
    CHECK(model::BlendNetwork::coarseness(side) == expected);
  }
  const test::TemporaryFolder folder;
  const auto path = saved(folder, *trained_looking(kBlend));
  const core::OlatScan scan = busy_scan({30, 701, 3}, 20);
  const Image image = model::make_network_interpolator(scan, path)->render(Direction::from_vector({0.2, 0.1, 1}));
  CHECK((image.size() == ImageSize{30, 701, 3}));
  CHECK(finite(image));
}

TEST_CASE(
    "at every coarseness pixels keep their full size, and the light that leaves the active set counts for nothing") {
  const torch::NoGradGuard no_gradients;
  const auto lights = core::fibonacci_directions(40);
  const Direction query = Direction::from_vector({0.3, 0.2, 0.8});
  at::Generator generator = at::detail::createCPUGenerator(4);
  const Tensor images = torch::rand({8, 3, 48, 24}, generator), guide = torch::rand({1, 3, 48, 24}, generator);
  const auto predict = [&](const Network& network, const Tensor& seen, int coarseness) {
    const model::ActiveSet set = network.active_set(query, lights, core::nearest_indices(lights, query, 8), 0.5);
    return dynamic_cast<const model::BlendNetwork&>(network).predict(seen, guide, set, coarseness);
  };
  const auto difference = [](const Tensor& a, const Tensor& b) { return (a - b).abs().max().item<double>(); };

  // Equal logits everywhere and no residual: nothing is left that an average of pixels could blur.
  const std::unique_ptr<Network> uniform = model::make_network(kBlend, 3);
  Tensor(uniform->parameter("head.logit.bias")).fill_(0.5);
  const std::unique_ptr<Network> network = trained_looking(kBlend);
  Tensor replaced = images.clone();
  replaced[7] = torch::rand({3, 48, 24}, generator);
  for (const int coarseness : {1, 2, 3, 6}) {
    CAPTURE(coarseness);
    CHECK(difference(predict(*uniform, images, coarseness), predict(*uniform, images, 1)) < 1e-6);
    CHECK(difference(predict(*network, images, coarseness), predict(*network, replaced, coarseness)) < 1e-6);
    if (coarseness > 1) CHECK(difference(predict(*network, images, coarseness), predict(*network, images, 1)) > 1e-3);
  }
}

TEST_CASE("blend passes a hot pixel on and leaves its surroundings alone") {
  const test::TemporaryFolder folder;
  const auto path = saved(folder, *model::make_network(kBlend, 1));
  const auto value = [](const Direction&, int y, int x, int) { return y == 4 && x == 4 ? 1e5 : 0.5; };
  const auto scan = test::scan_of(core::fibonacci_directions(20), {9, 10, 3}, value);
  const Image hot = model::make_network_interpolator(scan, path)->render(Direction::from_vector({0.1, 0.3, 1}));
  CHECK(hot(4, 4) == Approx(1e5).epsilon(1e-3));
  CHECK(hot(0, 0) == Approx(0.5).epsilon(1e-3));
}

TEST_CASE("a network read from its file is the network that was saved") {
  const test::TemporaryFolder folder;
  const auto config = GENERATE(kBlend, kSuperres, kXu, kXuAdaptive, kMeka);
  const auto network = trained_looking(config);
  const auto read = model::load_network(saved(folder, *network));
  CHECK(read->config() == config);
  REQUIRE(read->parameters().size() == network->parameters().size());
  for (const auto& [name, parameter] : network->parameters()) CHECK(torch::equal(parameter, read->parameter(name)));
}

TEST_CASE("group normalisation with PReLU equals torch's, with its gradients, on any number of threads") {
  torch::manual_seed(5);
  for (const auto& [channels, groups, height, width] :
       {std::tuple{8, 1, 1, 1}, {8, 2, 3, 5}, {12, 3, 17, 13}, {16, 2, 61, 97}, {4, 4, 2, 1}}) {
    const auto random = [](std::vector<std::int64_t> shape) { return torch::randn(shape); };
    const Tensor x = random({3, channels, height, width}) * 3 + 5;
    const Tensor scale = random({channels}), shift = random({channels}), slope = random({channels});
    const Tensor up = random({3, channels, height, width});
    const auto results = [&](bool fused, torch::Dtype type) {
      std::vector<Tensor> inputs;
      for (const Tensor& t : {x, scale, shift, slope})
        inputs.push_back(t.to(type).detach().clone().requires_grad_(true));
      const Tensor y = fused
                           ? model::norm_prelu(inputs[0], inputs[1], inputs[2], inputs[3], groups)
                           : torch::prelu(torch::group_norm(inputs[0], groups, inputs[1], inputs[2], 1e-5), inputs[3]);
      const Tensor z = fused ? model::channel_prelu(inputs[0], inputs[3]) : torch::prelu(inputs[0], inputs[3]);
      ((y + z) * up.to(type)).sum().backward();
      std::vector<Tensor> all{y.detach(), z.detach()};
      for (const Tensor& input : inputs) all.push_back(input.grad());
      return all;
    };
    const auto expected = results(false, torch::kFloat64);
    at::set_num_threads(1);
    const auto one = results(true, torch::kFloat32);
    at::set_num_threads(3);
    const auto three = results(true, torch::kFloat32);
    for (std::size_t i = 0; i < expected.size(); ++i) {
      CHECK(largest(one[i].to(torch::kFloat64) - expected[i]) < 2e-5 * (1 + largest(expected[i])));
      CHECK(torch::equal(one[i], three[i]));
    }
  }
  at::set_num_threads(core::thread_count());
}

TEST_CASE("the gradient of the sharpness is that of the loss, and finite at the extremes") {
  const core::OlatScan scan = busy_scan({8, 8, 3}, 60);
  const std::vector<Direction>& lights = scan.directions();
  const auto config = GENERATE(kBlend, kSuperres, kXuAdaptive);
  const auto loss = [&](const Network& network, const Direction& query, std::vector<std::size_t> active) {
    const model::ActiveSet set = network.active_set(query, lights, std::move(active), 0.45);
    std::vector<Tensor> displays;
    for (const std::size_t i : set.lights) displays.push_back(model::to_display(*scan.image(i), 1));
    const Tensor images = torch::stack(displays);
    return network.predict(images, images.narrow(0, 0, 1), set).square().mean();
  };
  const auto set_log_sharpness = [](Network& network, double value) {
    const torch::NoGradGuard no_gradients;
    Tensor parameter = network.parameter("log_sharpness");
    parameter.fill_(value);
  };

  const Direction query = Direction::from_vector({0.3, 0.1, 1});
  const auto active = core::nearest_indices(lights, query, 8);
  const auto network = trained_looking(config);
  loss(*network, query, active).backward();
  const double gradient = network->parameter("log_sharpness").grad().item<double>();
  const double middle = std::log(config.sharpness), step = 0.02;
  set_log_sharpness(*network, middle + step);
  const double above = loss(*network, query, active).item<double>();
  set_log_sharpness(*network, middle - step);
  const double below = loss(*network, query, active).item<double>();
  CHECK(gradient == Approx((above - below) / (2 * step)).epsilon(0.05));

  for (const double log_s : {-30.0, 0.0, 13.8}) {
    for (const auto& [q, set] :
         {std::pair{lights[7], core::nearest_indices(lights, lights[7], 8)},
          {Direction::from_vector(-lights[7].vec()), core::nearest_indices(lights, lights[7], 8)},
          {query, std::vector<std::size_t>{3}},
          {query, std::vector<std::size_t>{3, 3, 3}}}) {
      const auto extreme = trained_looking(config);
      set_log_sharpness(*extreme, log_s);
      loss(*extreme, q, set).backward();
      for (const auto& [name, parameter] : extreme->parameters()) {
        if (parameter.grad().defined()) CHECK(torch::isfinite(parameter.grad()).all().item<bool>());
      }
    }
  }
}

TEST_CASE("a training example never shows its query's light, nor any light in that place") {
  auto lights = core::fibonacci_directions(40);
  lights.push_back(lights[9]);  // 40 stands where 9 stands
  const ImageSize size{11, 14, 3};
  const auto value = [](const Direction& l, int y, int x, int) {
    return 0.6 + 0.4 * std::sin(y + 3 * l.x() + x * l.y());
  };
  const core::OlatScan scan = test::scan_of(lights, size, value);
  model::TrainOptions options;
  options.config = kBlend;
  options.crop = 16;
  options.active_set = GENERATE(model::ActiveSetChoice::kRandom, model::ActiveSetChoice::kThinned);
  const auto data = model::captured_data(std::span(&scan, 1), options, 4);
  const auto apart = [](const model::Example& example) {
    CHECK(example.lights.size() == 8);
    for (const Direction& other : example.lights) CHECK(angle_radians(example.query, other) > 1e-3);
  };
  std::vector<Direction> trained, validated;
  for (int i = 0; i < 300; ++i) {
    const model::Example example = data->training_draw(i);
    apart(example);
    trained.push_back(example.query);
  }
  for (int i = 0; i < data->validation_count(); ++i) {
    const model::Example example = data->validation_draw(i);
    apart(example);
    if (example.query == lights[9]) continue;  // two lights, one of each kind
    CHECK(std::find(trained.begin(), trained.end(), example.query) == trained.end());
  }

  // A guide does not change with the picture that it stands for, but for the exposure that all are relative to.
  const core::OlatScan changed = test::scan_of(
      lights, size, [&](const Direction& l, int y, int x, int c) { return l == lights[9] ? 0.0 : value(l, y, x, c); });
  const auto changed_data = model::captured_data(std::span(&changed, 1), options, 4);
  int compared = 0;
  for (int i = 0; i < 300; ++i) {
    const model::Example before = data->training_draw(i), after = changed_data->training_draw(i);
    if (!(before.query == lights[9])) continue;
    ++compared;
    const auto guide = [](const model::Example& e, const core::OlatScan& of) {
      return e.guide * std::pow(of.exposure(), 1 / 2.2);
    };
    CHECK(largest(guide(after, changed) - guide(before, scan)) < 2e-3);  // half precision
  }
  CHECK(compared > 0);
}

TEST_CASE(
    "in a thinned stage a captured light stands between the others as queries do, and its guide is that stage's") {
  const auto lights = core::fibonacci_directions(150);
  const double spacing = core::median_spacing_radians(lights);
  // Linear in the light's position, which thin-plate interpolation reproduces from any lights.
  const core::OlatScan scan = test::scan_of(lights, {8, 8, 3}, [](const Direction& l, int y, int x, int) {
    return std::pow(0.5 + 0.2 * l.x() - 0.1 * l.y() + 0.01 * (x + y), 2.2);
  });
  model::TrainOptions options;
  options.config = kBlend;
  const auto data = model::captured_data(std::span(&scan, 1), options, 4);  // blend's default
  double nearest_sum = 0;
  for (int i = 0; i < 100; ++i) {
    const model::Example example = data->training_draw(i);
    REQUIRE(example.lights.size() == 8);
    double nearest = 10;
    for (std::size_t a = 0; a < example.lights.size(); ++a) {
      nearest = std::min(nearest, angle_radians(example.query, example.lights[a]));
      for (std::size_t b = 0; b < a; ++b) CHECK(angle_radians(example.lights[a], example.lights[b]) > 1.4 * spacing);
    }
    CHECK(example.spacing > 1.4 * spacing);
    CHECK(example.spacing < 3.5 * spacing);
    CHECK(nearest == angle_radians(example.query, example.lights[0]));
    nearest_sum += nearest / example.spacing;
    CHECK(largest((example.guide - example.truth) * example.mask) < 3e-3);  // half precision
  }
  CHECK(nearest_sum / 100 > 0.4);
  CHECK(nearest_sum / 100 < 0.75);
  // Small stages keep enough for the network.
  const core::OlatScan few =
      test::scan_of(core::fibonacci_directions(10), {8, 8, 3}, [](const Direction&, int, int, int) { return 1.0; });
  CHECK(model::captured_data(std::span(&few, 1), options, 4)->training_draw(0).lights.size() == 8);
}

}  // namespace lightstage
