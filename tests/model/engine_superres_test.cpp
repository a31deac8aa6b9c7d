// The engine against the network that is trained, and against plain libtorch: every size, number of neighbours, instruction set, number
// format, and way of keeping encodings.
#include <catch2/catch.hpp>

// torch brings a CHECK of its own, which ends the program.
#pragma push_macro("CHECK")
#include <torch/torch.h>
#pragma pop_macro("CHECK")

#include <map>
#include <thread>

#include "core/error.h"
#include "core/parallel.h"
#include "core/sphere.h"
#include "model/engine/network_weights.h"
#include "model/engine/straightforward.h"
#include "model/engine/superres_engine.h"
#include "model/metrics.h"
#include "model/net/superres_network.h"
#include "support/support.h"

namespace lightstage {
namespace {

using core::Direction;
using core::Image;
using model::Number;
using torch::Tensor;

// Channels that fill no block, one block, and more than a pair of blocks.
const model::NetworkConfig kOdd{.neighbours = 8, .channels = {4, 12, 20}, .query_channels = {8, 12}};
const model::NetworkConfig kWide{.neighbours = 8, .channels = {32, 40, 72, 96}, .query_channels = {16, 64}};

// Weights as training might leave them: nothing is 0 or 1 any more.
model::SuperresNetwork trained_looking(const model::NetworkConfig& config) {
  model::SuperresNetwork network(config, 3);
  torch::manual_seed(11);
  const torch::NoGradGuard no_gradients;
  for (const auto& [name, tensor] : network.parameters()) {
    if (name == "log_sharpness") continue;
    Tensor target = tensor;
    if (tensor.dim() == 1) target.add_(0.2 * torch::randn(tensor.sizes()));
  }
  return network;
}

Image image_of(const Tensor& chw) {
  const Tensor pixels = chw.permute({1, 2, 0}).contiguous();
  Image image(int(pixels.size(0)), int(pixels.size(1)), 3);
  std::copy_n(pixels.data_ptr<float>(), pixels.numel(), image.values().begin());
  return image;
}

double largest_difference(const Image& a, const Image& b) {
  REQUIRE(a.size() == b.size());
  double largest = 0;
  for (std::size_t i = 0; i < a.values().size(); ++i) {
    const double difference = std::abs(double(a.values()[i]) - double(b.values()[i]));
    if (!(difference <= largest)) largest = difference;
  }
  return largest;
}

// A network, a stage of lights with a picture each, and a query.
struct Scene {
  explicit Scene(const model::NetworkConfig& config, int height = 24, int width = 40, int lights = 40)
      : network(trained_looking(config)),
        directions(core::fibonacci_directions(std::size_t(lights))),
        images(smooth(lights, height, width)) {
    spacing = core::median_spacing_radians(directions);
  }

  // Pictures with edges and noise, in [0, 1].
  static Tensor smooth(int lights, int height, int width) {
    torch::manual_seed(5);
    const Tensor coarse = torch::rand({lights, 3, height / 8 + 2, width / 8 + 2});
    const auto large = torch::nn::functional::InterpolateFuncOptions()
                           .size(std::vector<std::int64_t>{height, width})
                           .mode(torch::kBilinear)
                           .align_corners(false);
    return (0.8 * torch::nn::functional::interpolate(coarse, large) + 0.2 * torch::rand({lights, 3, height, width}))
        .contiguous(at::MemoryFormat::ChannelsLast);
  }

  model::ActiveSet set(std::size_t k) const {
    return network.active_set(query, directions, core::nearest_indices(directions, query, k), spacing);
  }
  Tensor images_of(const model::ActiveSet& active) const {
    std::vector<std::int64_t> indices(active.lights.begin(), active.lights.end());
    return images.index_select(0, torch::tensor(indices)).contiguous(at::MemoryFormat::ChannelsLast);
  }
  Image by_network(std::size_t k) const {
    const torch::NoGradGuard no_gradients;
    const model::ActiveSet active = set(k);
    return image_of(network.predict(images_of(active), {}, active)[0]);
  }
  Image by_plain_torch(std::size_t k) const {
    const torch::NoGradGuard no_gradients;
    const model::ActiveSet active = set(k);
    return image_of(model::StraightforwardSuperres(network).predict(images_of(active), active)[0]);
  }

  model::SuperresEngine engine(const model::EngineOptions& options = {}) const {
    const model::NetworkWeights weights(network);
    const core::ImageSize size{int(images.size(2)), int(images.size(3)), 3};
    return {weights.view(), size, directions,
            [this](std::size_t light) {
              ++loads[light];
              return image_of(images[std::int64_t(light)]);
            },
            options};
  }
  Image by_engine(std::size_t k, const model::EngineOptions& options = {}) const {
    return rendered(engine(options), k);
  }
  Image rendered(const model::SuperresEngine& made, std::size_t k) const {
    const torch::NoGradGuard no_gradients;
    const model::ActiveSet active = set(k);
    return made.render(query, active.lights, std::span(active.weights.data_ptr<float>(), active.lights.size()));
  }

  model::SuperresNetwork network;
  std::vector<Direction> directions;
  Tensor images;
  double spacing;
  Direction query = Direction::from_vector({0.3, 0.2, 0.9});
  mutable std::map<std::size_t, int> loads;
};

struct Threads {
  explicit Threads(int n) { core::set_thread_count(n); }
  ~Threads() { core::set_thread_count(0); }
};

TEST_CASE("the engine's picture is the network's, and plain libtorch's") {
  const auto [height, width] = GENERATE(table<int, int>({{8, 8}, {8, 72}, {24, 40}, {104, 8}, {88, 136}}));
  const Scene scene(kOdd, height, width);
  const Image picture = scene.by_engine(8);
  CHECK(largest_difference(picture, scene.by_network(8)) < 1e-4);
  CHECK(largest_difference(picture, scene.by_plain_torch(8)) < 1e-4);
}

TEST_CASE("the engine agrees with the network where channels fill several blocks") {
  const Scene scene(kWide, 48, 112);
  CHECK(largest_difference(scene.by_engine(8), scene.by_network(8)) < 1e-4);
}

TEST_CASE("the engine takes any number of neighbours") {
  const Scene scene(kOdd, 16, 24);
  for (std::size_t k = 1; k <= 16; ++k) {
    CAPTURE(k);
    CHECK(largest_difference(scene.by_engine(k), scene.by_network(k)) < 1e-4);
  }
}

TEST_CASE("every instruction set gives the same picture to rounding") {
  const Scene scene(kWide, 32, 80);
  const Image expected = scene.by_network(8);
  const torch::NoGradGuard no_gradients;
  const model::NetworkWeights weights(scene.network);
  const model::ActiveSet active = scene.set(8);
  for (const model::Kernels* kernels : model::all_float_kernels()) {
    CAPTURE(kernels->name);
    const model::Encoder encoder(weights.view(), *kernels);
    std::vector<model::Encoding> encodings;
    for (const std::size_t light : active.lights) {
      encodings.push_back(
          encoder.encode(image_of(scene.images[std::int64_t(light)]), scene.directions[light], Number::kFloat32));
    }
    model::WeightedEncodings pooled;
    for (std::size_t i = 0; i < encodings.size(); ++i) {
      pooled.encodings.push_back(&encodings[i]);
      pooled.weights.push_back(active.weights[std::int64_t(i)].item<float>());
    }
    const model::Decoder decoder(weights.view(), *kernels);
    CHECK(largest_difference(decoder.decode(pooled, scene.query), expected) < 1e-4);
  }
}

TEST_CASE("bfloat16 products and float16 encodings stay within their stated accuracy") {
  const Scene scene(kWide, 96, 112);
  const Image expected = scene.by_network(8);
  const Image stored = scene.by_engine(8, {.storage = Number::kFloat16});
  CHECK(largest_difference(stored, expected) < 1e-3);
  CHECK(model::dssim(stored, expected, {}) < 1e-5);
  CHECK(largest_difference(stored, scene.by_engine(8)) > 1e-6);  // it was not float32 after all
  if (model::bfloat_kernels() == nullptr) {
    CHECK_THROWS_AS(scene.by_engine(8, {.products = Number::kBfloat16}), core::UsageError);
    return;
  }
  for (const Number storage : {Number::kFloat32, Number::kFloat16}) {
    const Image multiplied = scene.by_engine(8, {.products = Number::kBfloat16, .storage = storage});
    CHECK(largest_difference(multiplied, expected) < 1e-2);
    CHECK(model::dssim(multiplied, expected, {}) < 1e-3);
  }
}

TEST_CASE("16-bit numbers stay within their stated accuracy at every size and number of neighbours") {
  const auto [height, width] = GENERATE(table<int, int>({{8, 8}, {8, 72}, {56, 40}, {104, 8}}));
  const Scene scene(kOdd, height, width);
  for (const std::size_t k : {1, 2, 7, 16}) {
    CAPTURE(height, width, k);
    const Image expected = scene.by_network(k);
    CHECK(largest_difference(scene.by_engine(k, {.storage = Number::kFloat16}), expected) < 1e-3);
    if (model::bfloat_kernels() == nullptr) continue;
    const Image multiplied = scene.by_engine(k, {.products = Number::kBfloat16, .storage = Number::kFloat16});
    CHECK(largest_difference(multiplied, expected) < 1e-2);
  }
}

TEST_CASE("the engine's picture is the same bit by bit for every thread count") {
  const Scene scene(kWide, 112, 80);
  for (const Number products : {Number::kFloat32, Number::kBfloat16}) {
    if (products == Number::kBfloat16 && model::bfloat_kernels() == nullptr) continue;
    const auto render = [&, products](int threads) {
      const Threads limit(threads);
      return scene.by_engine(8, {.products = products});
    };
    const Image one = render(1);
    for (const int threads : {2, 3, 7}) CHECK(render(threads) == one);
  }
}

TEST_CASE("the last map computed twice gives the picture of the map that is kept") {
  for (const auto& [height, width] : {std::pair(16, 16), std::pair(80, 48), std::pair(144, 16)}) {
    const Scene scene(kWide, height, width);
    CHECK(scene.by_engine(8, {.decoder = {.largest_map_bytes = 0}}) == scene.by_engine(8));
  }
}

TEST_CASE("a picture does not depend on where encodings are kept") {
  const Scene scene(kOdd, 64, 48);
  const Image expected = scene.by_engine(8);
  const test::TemporaryFolder folder;
  const std::size_t few = 100 << 10;  // room for a few encodings, not for eight
  for (const Number storage : {Number::kFloat32, Number::kFloat16}) {
    const Image kept = scene.by_engine(8, {.storage = storage});
    for (const auto& [memory, spill] : {std::pair<std::size_t, std::size_t>(0, 0),
                                        {few, 0},
                                        {0, few},
                                        {few, few},
                                        {0, std::size_t(1) << 30},
                                        {few, std::size_t(1) << 30}}) {
      CAPTURE(memory, spill);
      const model::EngineOptions options{
          .storage = storage, .budget = {.memory_bytes = memory, .spill_bytes = spill, .spill_folder = folder.path()}};
      const model::SuperresEngine engine = scene.engine(options);
      for (int query = 0; query < 2; ++query) {
        // Encodings that are not kept are not rounded either.
        const double tolerance = storage == Number::kFloat32 ? 1e-5 : 1e-3;
        CHECK(largest_difference(scene.rendered(engine, 8), kept) < tolerance);
        CHECK(largest_difference(scene.rendered(engine, 8), expected) < tolerance);
      }
    }
  }
}

TEST_CASE("a captured image is encoded once, and one that weighs nothing never") {
  const Scene scene(kOdd, 16, 16);
  const test::TemporaryFolder folder;
  for (const bool spilled : {false, true}) {
    scene.loads.clear();
    model::EngineOptions options;
    if (spilled)
      options.budget = {.memory_bytes = 0, .spill_bytes = std::size_t(1) << 30, .spill_folder = folder.path()};
    const model::SuperresEngine engine = scene.engine(options);
    for (int i = 0; i < 3; ++i) scene.rendered(engine, 8);
    const model::ActiveSet active = scene.set(8);
    int weighing = 0;
    for (std::size_t i = 0; i < active.lights.size(); ++i) {
      const bool weighs = active.weights[std::int64_t(i)].item<float>() != 0;
      weighing += weighs;
      CHECK(scene.loads[active.lights[i]] == (weighs ? 1 : 0));
    }
    CHECK(weighing == 7);
  }
}

TEST_CASE("queries in the neighbouring order encode hardly any image twice") {
  const Scene scene(kOdd, 16, 16, /*lights=*/120);
  const std::vector<Direction> queries = core::fibonacci_directions(250);
  const std::size_t encoding = model::encoding_bytes(kOdd.channels, {16, 16, 3}, Number::kFloat32);
  const auto encodings_made = [&](const std::vector<std::size_t>& order) {
    scene.loads.clear();
    const model::SuperresEngine engine =
        scene.engine({.budget = {.memory_bytes = 30 * encoding}});  // a quarter of them
    const torch::NoGradGuard no_gradients;
    for (const std::size_t i : order) {
      const model::ActiveSet active = scene.network.active_set(
          queries[i], scene.directions, core::nearest_indices(scene.directions, queries[i], 8), scene.spacing);
      engine.render(queries[i], active.lights, std::span(active.weights.data_ptr<float>(), active.lights.size()));
    }
    int made = 0;
    for (const auto& [light, loads] : scene.loads) made += loads;
    return made;
  };
  std::vector<std::size_t> as_they_come(queries.size());
  for (std::size_t i = 0; i < queries.size(); ++i) as_they_come[i] = i;
  const int in_order = encodings_made(core::neighbouring_order(queries));
  CHECK(in_order >= 120);
  CHECK(in_order < 2 * 120);
  CHECK(encodings_made(as_they_come) > 3 * in_order);
}

TEST_CASE("an encoding that is used stays, the one used least recently goes") {
  const auto encoding = [] {
    auto made = std::make_shared<model::Encoding>();
    made->levels.emplace_back(4, 4, 16, Number::kFloat32);
    return made;
  };
  model::EncodingCache cache({.memory_bytes = 2 * encoding()->bytes()});
  cache.keep(1, encoding());
  cache.keep(2, encoding());
  CHECK(cache.find(1) != nullptr);
  cache.keep(3, encoding());
  CHECK(cache.find(1) != nullptr);
  CHECK(cache.find(2) == nullptr);
  CHECK(cache.find(3) != nullptr);
}

TEST_CASE("a spill folder that takes no files is named") {
  const Scene scene(kOdd, 16, 16);
  const auto engine =
      scene.engine({.budget = {.memory_bytes = 0, .spill_bytes = std::size_t(1) << 30, .spill_folder = "/nowhere"}});
  CHECK_THROWS_WITH(scene.rendered(engine, 8), Catch::Contains("/nowhere"));
}

TEST_CASE("a folder for temporary files is needed for spilling only, and named where it is missing") {
  const Scene scene(kOdd, 16, 16);
  const test::EnvironmentVariable variable("TMPDIR", "/nowhere");
  CHECK_NOTHROW(scene.by_engine(8));
  const auto engine = scene.engine({.budget = {.memory_bytes = 0, .spill_bytes = std::size_t(1) << 30}});
  CHECK_THROWS_AS(scene.rendered(engine, 8), core::BadInput);
  CHECK_THROWS_WITH(scene.rendered(engine, 8), Catch::Contains("TMPDIR=/nowhere"));
}

TEST_CASE("extreme images give finite pictures, the network's") {
  Scene scene(kOdd, 24, 24);
  const auto [name, value] =
      GENERATE(table<const char*, float>({{"black", 0.f}, {"denormal", 1e-40f}, {"bright", 1e30f}}));
  CAPTURE(name);
  scene.images.fill_(value);
  const Image picture = scene.by_engine(8);
  CHECK(largest_difference(picture, scene.by_network(8)) < 1e-4);

  scene.images.fill_(0.2f);
  scene.images.select(2, 3).select(2, 5).fill_(1e5f);  // one hot pixel
  CHECK(largest_difference(scene.by_engine(8), scene.by_network(8)) < 1e-4);
}

TEST_CASE("several threads render at the same time") {
  const Scene scene(kOdd, 48, 32);
  const Image expected = scene.by_engine(8);
  const model::SuperresEngine engine = scene.engine();
  std::vector<Image> pictures(4);
  std::vector<std::thread> threads;
  // Loading counts, so all is loaded before.
  pictures[0] = scene.rendered(engine, 8);
  for (std::size_t i = 1; i < 4; ++i) threads.emplace_back([&, i] { pictures[i] = scene.rendered(engine, 8); });
  for (std::thread& thread : threads) thread.join();
  for (const Image& picture : pictures) CHECK(picture == expected);
}

}  // namespace
}  // namespace lightstage
