// The engine's parts one by one: where a query's time goes.
//   build/release/tests/bench_engine --benchmark_filter=decode
#include <benchmark/benchmark.h>
#include <torch/torch.h>

#include "core/parallel.h"
#include "core/sphere.h"
#include "model/engine/network_weights.h"
#include "model/engine/superres_engine.h"
#include "model/net/norm_prelu.h"
#include "model/net/pixels.h"
#include "model/net/superres_network.h"
#include "model/net/transposed_convolution.h"

namespace lightstage {
namespace {

using model::Number;
using torch::Tensor;

const model::SuperresNetwork& paper_network() {
  static const model::SuperresNetwork network(model::network_preset("paper"), /*seed=*/7);
  return network;
}

core::Image noise(int size) {
  core::Image image(size, size, 3);
  const Tensor values = torch::rand({std::int64_t(image.values().size())});
  std::copy_n(values.data_ptr<float>(), image.values().size(), image.values().begin());
  return image;
}

void encode(benchmark::State& state) {
  const model::NetworkWeights weights(paper_network());
  const model::Encoder encoder(weights.view());
  const core::Image image = noise(int(state.range(0)));
  const core::Direction light = core::Direction::from_vector({0, 0, 1});
  for (auto _ : state) benchmark::DoNotOptimize(encoder.encode(image, light, Number::kFloat32));
}
BENCHMARK(encode)->Arg(256)->Arg(512)->Arg(1024)->UseRealTime()->Unit(benchmark::kMillisecond);

// Eight encodings, all of which weigh something.
void decode(benchmark::State& state, Number products, Number storage, std::size_t largest_map_bytes) {
  if (products == Number::kBfloat16 && model::bfloat_kernels() == nullptr) {
    state.SkipWithError("this processor has no bfloat16 instructions");
    return;
  }
  const model::NetworkWeights weights(paper_network());
  const model::Encoder encoder(weights.view());
  const core::Image image = noise(int(state.range(0)));
  std::vector<model::Encoding> encodings;
  model::WeightedEncodings pooled;
  for (const core::Direction& light : core::fibonacci_directions(8)) {
    encodings.push_back(encoder.encode(image, light, storage));
  }
  for (const model::Encoding& encoding : encodings) {
    pooled.encodings.push_back(&encoding);
    pooled.weights.push_back(0.125f);
  }
  const model::Decoder decoder(weights.view(), model::kernels_for(products), {.largest_map_bytes = largest_map_bytes});
  const core::Direction query = core::Direction::from_vector({0, 0, 1});
  for (auto _ : state) benchmark::DoNotOptimize(decoder.decode(pooled, query));
}
constexpr std::size_t kNoLimit = std::size_t(1) << 40;
BENCHMARK_CAPTURE(decode, float32, Number::kFloat32, Number::kFloat32, kNoLimit)
    ->Arg(256)
    ->Arg(512)
    ->Arg(1024)
    ->UseRealTime()
    ->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(decode, float32_stored_float16, Number::kFloat32, Number::kFloat16, kNoLimit)
    ->Arg(1024)
    ->UseRealTime()
    ->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(decode, float32_last_map_twice, Number::kFloat32, Number::kFloat32, 0)
    ->Arg(1024)
    ->UseRealTime()
    ->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(decode, bfloat16, Number::kBfloat16, Number::kFloat16, kNoLimit)
    ->Arg(256)
    ->Arg(512)
    ->Arg(1024)
    ->UseRealTime()
    ->Unit(benchmark::kMillisecond);

// One layer of the decoder, of 128 to 32 channels, forward and backward, as training has it.
void doubling(benchmark::State& state, bool plain) {
  const Tensor x = torch::randn({1, 128, 128, 128}).contiguous(at::MemoryFormat::ChannelsLast).set_requires_grad(true);
  const Tensor weight = torch::randn({128, 32, 3, 3}).set_requires_grad(true);
  const Tensor bias = torch::zeros({32}).set_requires_grad(true);
  for (auto _ : state) {
    const Tensor y =
        plain ? torch::conv_transpose2d(x, weight, bias, 2, 1, 1) : model::doubling_convolution(x, weight, bias);
    benchmark::DoNotOptimize(torch::autograd::grad({y}, {x, weight, bias}, {torch::ones_like(y)}));
  }
}
BENCHMARK_CAPTURE(doubling, conv_transpose2d, true)->UseRealTime()->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(doubling, doubling_convolution, false)->UseRealTime()->Unit(benchmark::kMillisecond);

void normalise(benchmark::State& state, bool plain) {
  const Tensor x = torch::randn({1, 32, 512, 512}).contiguous(at::MemoryFormat::ChannelsLast).set_requires_grad(true);
  const Tensor scale = torch::ones({32}), shift = torch::zeros({32}), slope = torch::full({32}, 0.25);
  for (auto _ : state) {
    const Tensor y = plain ? torch::prelu(torch::group_norm(x, 4, scale, shift, 1e-5), slope)
                           : model::norm_prelu(x, scale, shift, slope, 4);
    benchmark::DoNotOptimize(torch::autograd::grad({y}, {x}, {torch::ones_like(y)}));
  }
}
BENCHMARK_CAPTURE(normalise, group_norm_and_prelu, true)->UseRealTime()->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(normalise, norm_prelu, false)->UseRealTime()->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace lightstage

int main(int argc, char** argv) {
  benchmark::Initialize(&argc, argv);
  if (benchmark::ReportUnrecognizedArguments(argc, argv)) return 1;
  lightstage::model::prepare_torch();
  benchmark::RunSpecifiedBenchmarks();
  return 0;
}
