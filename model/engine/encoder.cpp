#include "model/engine/encoder.h"

#include <malloc.h>

#include <algorithm>
#include <cstring>
#include <utility>

#include "core/parallel.h"

namespace lightstage::model {
namespace {

constexpr Margin kLeft{.left = 1};
constexpr int kImageChannels = 6;
constexpr int kBandRows = 8;
constexpr std::size_t kLargeImageBytes = std::size_t(64) << 20;

std::size_t bands(int height) {
  return std::size_t((height + kBandRows - 1) / kBandRows);
}

FeatureMap shape_of(std::size_t level, core::ImageSize image, int channels, Number number) {
  return FeatureMap::shape(image.height >> (level + 1), image.width >> (level + 1), channels, number, kLeft);
}

}  // namespace

std::size_t Encoding::bytes() const {
  std::size_t total = 0;
  for (const FeatureMap& level : levels) total += level.bytes();
  return total;
}

std::size_t encoding_bytes(std::span<const int> channels, core::ImageSize image, Number number) {
  std::size_t total = 0;
  for (std::size_t level = 0; level < channels.size(); ++level)
    total += shape_of(level, image, channels[level], number).bytes();
  return total;
}

Encoder::Encoder(const SuperresWeights& weights, const Kernels& kernels)
    : kernels_(kernels), brightest_input_(weights.brightest_input) {
  int in = kImageChannels;
  for (std::size_t level = 0; level < weights.channels.size(); ++level) {
    const std::string name = "encoder." + std::to_string(level);
    layers_.push_back({PackedConvolution::halving(weights.tensor(name + ".conv.weight"),
                                                  weights.tensor(name + ".conv.bias"), in, kernels.number),
                       norm_prelu_weights(weights, name)});
    in = weights.channels[level];
  }
}

FeatureMap Encoder::level_shape(std::size_t level, core::ImageSize image, Number number) const {
  return shape_of(level, image, layers_[level].convolution.output_channels(), number);
}

void Encoder::normalise(const Layer& layer, std::span<const Moments> moments, std::size_t parts,
                        const FeatureMap& map) const {
  const std::vector<BlockAffine> affine = group_norm(moments, parts, layer.norm);
  core::parallel_for(std::size_t(map.height()), kBandRows, [&](std::size_t first, std::size_t last) {
    for (int y = int(first); y < int(last); ++y) {
      const Row row = map.row(y);
      for (int b = 0; b < map.blocks(); ++b) {
        std::byte* const block = row.data + std::size_t(b) * row.block_bytes;
        kernels_.normalise(reinterpret_cast<const float*>(block), block, std::size_t(map.width()),
                           affine[std::size_t(b)]);
      }
    }
  });
}

FeatureMap Encoder::first_level(core::ImageView image, const core::Direction& light) const {
  const Layer& layer = layers_.front();
  const int height = image.height() / 2, width = image.width() / 2;
  FeatureMap map(height, width, layer.convolution.output_channels(), Number::kFloat32, kLeft);
  const std::size_t pairs = std::size_t(layer.convolution.pairs()), parts = bands(height);
  std::vector<Moments> moments(pairs * parts);
  const float xyz[3] = {float(light.x()), float(light.y()), float(light.z())};
  const std::size_t row_floats = std::size_t(1 + image.width()) * kLanes;

  core::parallel_for(parts, 1, [&](std::size_t part, std::size_t) {
    // Image rows 2y - 1 .. 2y + 1 as maps of one block; the last of them is the next output row's first. Row 3 stays zero.
    std::vector<float> scratch(4 * row_floats, 0.f);
    const auto row = [&](int n) { return scratch.data() + std::size_t(n) * row_floats + kLanes; };
    const auto fill = [&](int y, float* out) {
      const float* in = image.row(y);
      for (int x = 0; x < image.width(); ++x, in += 3, out += kLanes) {
        for (int c = 0; c < 3; ++c) out[c] = std::min(in[c], brightest_input_);
        std::copy_n(xyz, 3, out + 3);
      }
    };
    const int first = int(part) * kBandRows, last = std::min(height, first + kBandRows);
    if (first > 0) fill(2 * first - 1, row(first % 2 == 0 ? 2 : 0));
    for (int y = first; y < last; ++y) {
      const int above = y % 2 == 0 ? 2 : 0, below = 2 - above;
      fill(2 * y, row(1));
      fill(2 * y + 1, row(below));
      const auto view = [&](int n) { return ConstRow{reinterpret_cast<const std::byte*>(row(n)), 0}; };
      const ConstRow rows[3] = {view(y == 0 ? 3 : above), view(1), view(below)};
      for (std::size_t pair = 0; pair < pairs; ++pair) {
        layer.convolution.run_row(kernels_, int(pair), layer.convolution.phases()[0], rows, width, map.row(y),
                                  /*past_caches=*/false, moments[pair * parts + part]);
      }
    }
  });
  normalise(layer, moments, parts, map);
  return map;
}

FeatureMap Encoder::next_level(const Layer& layer, const FeatureMap& below) const {
  const int height = below.height() / 2, width = below.width() / 2;
  FeatureMap map(height, width, layer.convolution.output_channels(), Number::kFloat32, kLeft);
  const std::size_t pairs = std::size_t(layer.convolution.pairs()), parts = bands(height);
  std::vector<Moments> moments(pairs * parts);
  const FeatureMap zeros(1, below.width(), below.blocks() * kLanes, Number::kFloat32, kLeft);
  core::parallel_for(pairs * parts, 1, [&](std::size_t task, std::size_t) {
    const int first = int(task % parts) * kBandRows, last = std::min(height, first + kBandRows);
    for (int y = first; y < last; ++y) {
      const ConstRow rows[3] = {y == 0 ? zeros.row(0) : below.row(2 * y - 1), below.row(2 * y), below.row(2 * y + 1)};
      layer.convolution.run_row(kernels_, int(task / parts), layer.convolution.phases()[0], rows, width, map.row(y),
                                /*past_caches=*/false, moments[task]);
    }
  });
  normalise(layer, moments, parts, map);
  return map;
}

void Encoder::encode(core::Image image, const core::Direction& light,
                     const std::function<void(std::size_t level, FeatureMap map)>& receive) const {
  FeatureMap below = first_level(image, light);
  const std::size_t image_bytes = image.values().size() * sizeof(float);
  image = core::Image();
  // What malloc keeps of freed images would stand beside the largest maps.
  if (image_bytes >= kLargeImageBytes) ::malloc_trim(0);
  for (std::size_t level = 1; level < layers_.size(); ++level) {
    FeatureMap next = next_level(layers_[level], below);
    receive(level - 1, std::exchange(below, FeatureMap()));
    below = std::move(next);
  }
  receive(layers_.size() - 1, std::move(below));
}

Encoding Encoder::encode(core::Image image, const core::Direction& light, Number number) const {
  Encoding encoding;
  encode(std::move(image), light, [&](std::size_t, FeatureMap map) {
    encoding.levels.push_back(number == Number::kFloat32 ? std::move(map) : shortened(map, kernels_));
  });
  return encoding;
}

FeatureMap shortened(const FeatureMap& map, const Kernels& kernels) {
  FeatureMap result(map.height(), map.width(), map.blocks() * kLanes, Number::kFloat16, kLeft);
  core::parallel_for(std::size_t(map.height()), kBandRows, [&](std::size_t first, std::size_t last) {
    for (int y = int(first); y < int(last); ++y) {
      const Row from = map.row(y), to = result.row(y);
      for (int b = 0; b < map.blocks(); ++b) {
        kernels.shorten(reinterpret_cast<const float*>(from.data + std::size_t(b) * from.block_bytes),
                        reinterpret_cast<Float16*>(to.data + std::size_t(b) * to.block_bytes),
                        std::size_t(map.width()));
      }
    }
  });
  return result;
}

}  // namespace lightstage::model
