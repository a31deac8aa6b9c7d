// The pair of input and output by which another implementation can check itself (docs/model.md). `test_model "[.write]"` writes it anew.
#include <catch2/catch.hpp>

// torch brings a CHECK of its own, which ends the program.
#pragma push_macro("CHECK")
#include <ATen/CPUGeneratorImpl.h>
#include <torch/torch.h>
#pragma pop_macro("CHECK")

#include "core/sphere.h"
#include "model/net/network.h"
#include "model/net/network_file.h"
#include "model/net/safetensors.h"
#include "support/support.h"

namespace lightstage {
namespace {

using torch::Tensor;

const std::filesystem::path kFolder = LIGHTSTAGE_TEST_FIXTURES;
constexpr std::int64_t kNeighbours = 5, kHeight = 16, kWidth = 24;

model::NetworkConfig config_of(model::Architecture architecture) {
  model::NetworkConfig config{.architecture = architecture, .neighbours = int(kNeighbours), .channels = {8, 12, 16}};
  if (architecture == model::Architecture::kSuperres) config.query_channels = {8, 12};
  return config;
}

std::filesystem::path file_of(model::Architecture architecture, const char* what) {
  return kFolder / (std::string(model::architecture_name(architecture)) + "_" + what + ".safetensors");
}

model::NamedTensors empty_example() {
  return {{"images", torch::zeros({kNeighbours, 3, kHeight, kWidth})},
          {"guide", torch::zeros({1, 3, kHeight, kWidth})},
          {"lights", torch::zeros({kNeighbours, 3})},
          {"query", torch::zeros({3})},
          {"spacing", torch::zeros({})},
          {"weights", torch::zeros({kNeighbours})},
          {"picture", torch::zeros({1, 3, kHeight, kWidth})}};
}

const Tensor& tensor(const model::NamedTensors& tensors, const std::string& name) {
  return std::find_if(tensors.begin(), tensors.end(), [&](const auto& entry) { return entry.first == name; })->second;
}

core::Direction direction(const Tensor& xyz) {
  const float* const v = xyz.data_ptr<float>();
  return core::Direction::from_vector({v[0], v[1], v[2]});
}

struct Answer {
  Tensor weights, picture;
};

Answer answer(const model::Network& network, const model::NamedTensors& example) {
  const torch::NoGradGuard no_gradients;
  const Tensor lights = tensor(example, "lights");
  std::vector<core::Direction> directions;
  std::vector<std::size_t> all;
  for (std::int64_t i = 0; i < kNeighbours; ++i) {
    directions.push_back(direction(lights[i]));
    all.push_back(std::size_t(i));
  }
  const model::ActiveSet set = network.active_set(direction(tensor(example, "query")), directions, all,
                                                  tensor(example, "spacing").item<float>());
  return {set.weights, network.predict(tensor(example, "images"), tensor(example, "guide"), set)};
}

}  // namespace

TEST_CASE("both networks give the picture of the documented example") {
  const auto architecture = GENERATE(model::Architecture::kSuperres, model::Architecture::kBlend);
  const auto network = model::load_network(file_of(architecture, "weights"));
  REQUIRE(network->config() == config_of(architecture));
  const auto path = file_of(architecture, "example");
  const model::NamedTensors example = empty_example();
  model::read_tensors(path, model::read_safetensors_header(path), example);
  const Answer found = answer(*network, example);
  CHECK((found.weights - tensor(example, "weights")).abs().max().item<float>() < 1e-6f);
  CHECK((found.picture - tensor(example, "picture")).abs().max().item<float>() < 1e-5f);
  CHECK(tensor(example, "picture").std().item<float>() > 0.02f);
}

TEST_CASE("the documented example is written", "[.write]") {
  for (const auto architecture : {model::Architecture::kSuperres, model::Architecture::kBlend}) {
    at::Generator random = at::detail::createCPUGenerator(5);
    const auto network = model::make_network(config_of(architecture), 7);
    const torch::NoGradGuard no_gradients;
    for (auto [name, parameter] : network->parameters()) {
      // Nothing may be at the value at which it does nothing.
      if (name != "log_sharpness") parameter.add_(0.1 * torch::randn(parameter.sizes(), random));
    }
    model::NamedTensors example = empty_example();
    Tensor(tensor(example, "images")).copy_(torch::rand({kNeighbours, 3, kHeight, kWidth}, random));
    Tensor(tensor(example, "guide")).copy_(torch::rand({1, 3, kHeight, kWidth}, random));
    const auto lights = core::fibonacci_directions(60);
    const core::Direction query = core::Direction::from_vector({0.3, 0.2, 1});
    const auto active = core::nearest_indices(lights, query, std::size_t(kNeighbours));
    const auto set = [](Tensor row, const core::Direction& d) {
      row[0] = d.x();
      row[1] = d.y();
      row[2] = d.z();
    };
    for (std::int64_t i = 0; i < kNeighbours; ++i) set(tensor(example, "lights")[i], lights[active[std::size_t(i)]]);
    set(tensor(example, "query"), query);
    Tensor(tensor(example, "spacing")).fill_(core::median_spacing_radians(lights));
    const Answer found = answer(*network, example);
    Tensor(tensor(example, "weights")).copy_(found.weights);
    Tensor(tensor(example, "picture")).copy_(found.picture);
    model::save_network(file_of(architecture, "weights"), *network, "{}");
    model::write_tensors(file_of(architecture, "example"), {}, example);
  }
}

}  // namespace lightstage
