#include "model/engine_bench.h"

#include <sys/resource.h>
#include <torch/torch.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <optional>
#include <string>
#include <vector>

#include "core/error.h"
#include "core/parallel.h"
#include "core/sphere.h"
#include "model/engine/network_weights.h"
#include "model/engine/straightforward.h"
#include "model/engine/superres_engine.h"
#include "model/net/adam.h"
#include "model/net/pixels.h"
#include "model/net/superres_network.h"

namespace lightstage::model {
namespace {

using torch::Tensor;

constexpr std::uint64_t kSeed = 7;
constexpr int kStageLights = 302;
constexpr int kLargestCrop = 512;  // of training, as published

// Of the fastest of `runs` calls: what else the machine does can only add to a time.
template <class Work>
double seconds(int runs, const Work& work) {
  double best = INFINITY;
  for (int run = 0; run < runs; ++run) {
    const auto start = std::chrono::steady_clock::now();
    work();
    best = std::min(best, std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count());
  }
  return best;
}

struct DecoderShape {
  int in, out, size;  // channels, and pixels a side of the input
};

// By level.
std::vector<DecoderShape> decoder_shapes(const NetworkConfig& config, int size) {
  std::vector<DecoderShape> shapes;
  const std::vector<int>& channels = config.channels;
  for (std::size_t level = 0; level < channels.size(); ++level) {
    const bool coarsest = level + 1 == channels.size();
    shapes.push_back({(coarsest ? config.query_channels.back() : channels[level]) + channels[level],
                      channels[level == 0 ? 0 : level - 1], size >> (level + 1)});
  }
  return shapes;
}

double decoder_flops(const NetworkConfig& config, int size) {
  double flops = 18.0 * config.channels.front() * 3 * size * size;
  for (const DecoderShape& shape : decoder_shapes(config, size))
    flops += 18.0 * shape.in * shape.out * shape.size * shape.size;
  return flops;
}

// What a query cannot do without: the encodings that weigh something, every map of the decoder written and read, weights, picture.
double decoder_bytes(const NetworkConfig& config, int size, int encodings) {
  double values = 3.0 * size * size;
  for (std::size_t level = 0; level < config.channels.size(); ++level) {
    const DecoderShape shape = decoder_shapes(config, size)[level];
    values += double(encodings) * config.channels[level] * shape.size * shape.size;
    values += 2.0 * 4 * shape.out * shape.size * shape.size;
    values += 9.0 * shape.in * shape.out;
  }
  return values * sizeof(float);
}

// 3x3 convolutions with the channels and sizes of the decoder's layers.
double roofline_gflops(const NetworkConfig& config, int size) {
  double best = 0;
  for (const DecoderShape& shape : decoder_shapes(config, size)) {
    const auto last = at::MemoryFormat::ChannelsLast;
    const Tensor x = torch::randn({1, shape.in, shape.size, shape.size}).contiguous(last);
    const Tensor weight = torch::randn({shape.out, shape.in, 3, 3}).contiguous(last);
    const double time = seconds(5, [&] { torch::conv2d(x, weight, {}, /*stride=*/1, /*padding=*/1); });
    best = std::max(best, 18.0 * shape.in * shape.out * shape.size * shape.size / time * 1e-9);
  }
  return best;
}

core::Image image_of(const Tensor& chw) {
  const Tensor pixels = chw.permute({1, 2, 0}).contiguous();
  core::Image image(int(pixels.size(0)), int(pixels.size(1)), 3);
  std::copy_n(pixels.data_ptr<float>(), pixels.numel(), image.values().begin());
  return image;
}

double largest_difference(const core::Image& a, const core::Image& b) {
  double largest = 0;
  for (std::size_t i = 0; i < a.values().size(); ++i) {
    largest = std::max(largest, std::abs(double(a.values()[i]) - double(b.values()[i])));
  }
  return largest;
}

std::size_t peak_rss_bytes() {
  rusage usage{};
  ::getrusage(RUSAGE_SELF, &usage);
  return std::size_t(usage.ru_maxrss) * 1024;
}

// One step each: prediction, L1, gradients, Adam.
template <class Adam, class Predict>
double steps_per_second(const std::vector<Tensor>& parameters, const Tensor& truth, const Predict& predict) {
  Adam optimiser(parameters, torch::optim::AdamOptions(1e-3));
  const auto step = [&] {
    for (Tensor parameter : parameters) parameter.mutable_grad().reset();
    torch::l1_loss(predict(), truth).backward();
    optimiser.step();
  };
  step();
  return 1 / seconds(4, step);
}

}  // namespace

EngineBench bench_engine(const NetworkConfig& config, int size) {
  if (config.architecture != Architecture::kSuperres) {
    throw core::UsageError("the engine runs the published network: choose preset tiny, small or paper");
  }
  const int multiple = 1 << config.channels.size();
  if (size <= 0 || size % multiple != 0) {
    throw core::UsageError("this network takes sizes that are multiples of " + std::to_string(multiple) + ", not " +
                           std::to_string(size));
  }
  at::set_num_threads(core::thread_count());
  torch::manual_seed(kSeed);
  const SuperresNetwork network(config, kSeed);
  const std::vector<core::Direction> lights = core::fibonacci_directions(kStageLights);
  const core::Direction query = core::Direction::from_vector({0.1, 0.2, 0.97});
  const std::vector<std::size_t> active = core::nearest_indices(lights, query, std::size_t(config.neighbours));
  const double spacing = core::median_spacing_radians(lights);
  const Tensor images =
      torch::rand({std::int64_t(active.size()), 3, size, size}).contiguous(at::MemoryFormat::ChannelsLast);
  const auto load = [&](std::size_t light) {
    return image_of(images[std::find(active.begin(), active.end(), light) - active.begin()]);
  };

  EngineBench bench;
  bench.gflop_per_query = decoder_flops(config, size) * 1e-9;
  core::Image fast, fast_bf16, plain;
  {
    const torch::NoGradGuard no_gradients;
    const ActiveSet set = network.active_set(query, lights, active, spacing);
    const std::span<const float> weights(set.weights.data_ptr<float>(), active.size());
    bench.bytes_moved =
        decoder_bytes(config, size, int(std::count_if(weights.begin(), weights.end(), [](float w) { return w != 0; })));
    const NetworkWeights tensors(network);
    EngineOptions options;
    options.budget.memory_bytes = std::size_t(1) << 40;  // the steady state is what is measured
    const core::ImageSize image_size{size, size, 3};
    const SuperresEngine engine(tensors.view(), image_size, lights, load, options);
    std::optional<SuperresEngine> engine_bf16;
    if (bfloat_kernels() != nullptr) {
      options.products = Number::kBfloat16;
      options.storage = Number::kFloat16;
      engine_bf16.emplace(tensors.view(), image_size, lights, load, options);
      engine_bf16->render(query, active, weights);
    }
    engine.render(query, active, weights);
    // Before plain libtorch and after it: a machine that does other things at times shows both sides the same.
    const auto time_engines = [&] {
      const double time = seconds(5, [&] { fast = engine.render(query, active, weights); });
      bench.engine_s = bench.engine_s == 0 ? time : std::min(bench.engine_s, time);
      if (!engine_bf16) return;
      const double time_bf16 = seconds(5, [&] { fast_bf16 = engine_bf16->render(query, active, weights); });
      bench.engine_bf16_s = std::min(bench.engine_bf16_s.value_or(time_bf16), time_bf16);
    };
    time_engines();
    const Encoder encoder(tensors.view());
    const core::Image image = load(active.front());
    bench.encode_s = seconds(3, [&] { encoder.encode(image, lights[active.front()], Number::kFloat32); });
    bench.peak_rss_bytes = peak_rss_bytes();

    const StraightforwardSuperres straightforward(network);
    const Tensor rows = images.contiguous();
    Tensor picture;
    bench.straightforward_s = seconds(2, [&] { picture = straightforward.predict(rows, set); });
    plain = image_of(picture[0]);
    time_engines();
  }
  bench.max_abs_diff = largest_difference(fast, plain);
  if (bench.engine_bf16_s) bench.max_abs_diff_bf16 = largest_difference(fast_bf16, plain);

  bench.train_size = std::min(size, kLargestCrop);
  const Tensor crop = images.slice(2, 0, bench.train_size).slice(3, 0, bench.train_size);
  const Tensor last = crop.contiguous(at::MemoryFormat::ChannelsLast), rows = crop.contiguous();
  const Tensor truth = last.slice(0, 0, 1).contiguous();
  const StraightforwardSuperres straightforward(network);
  bench.straightforward_train_steps_per_s = steps_per_second<torch::optim::Adam>(
      straightforward.parameters(), truth,
      [&] { return straightforward.predict(rows, network.active_set(query, lights, active, spacing)); });

  // From here on memory is handled as training handles it, which plain libtorch does not do for itself.
  prepare_torch();
  std::vector<Tensor> parameters;
  for (const auto& [name, tensor] : network.parameters()) parameters.push_back(tensor);
  bench.train_steps_per_s = steps_per_second<OnePassAdam>(
      parameters, truth, [&] { return network.predict(last, {}, network.active_set(query, lights, active, spacing)); });
  const torch::NoGradGuard no_gradients;
  bench.roofline_gflops = roofline_gflops(config, size);
  return bench;
}

}  // namespace lightstage::model
