#include "model/engine/decoder.h"

#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <cstring>
#include <stdexcept>
#include <utility>

#include "core/parallel.h"
#include "model/engine/decoder_workspace.h"

namespace lightstage::model {
namespace {

constexpr int kMostEncodings = 64;
constexpr int kBandRows = 16;
constexpr double kEpsilon = 1e-5;
constexpr std::size_t kCachedBytes = std::size_t(16) << 20;  // larger maps have left the caches before they are read

std::size_t bands(int height) {
  return std::size_t((height + kBandRows - 1) / kBandRows);
}

int round_up(int value, int multiple) {
  return (value + multiple - 1) / multiple * multiple;
}

std::vector<float> copied(std::span<const float> values) {
  return {values.begin(), values.end()};
}

}  // namespace

Decoder::Decoder(const SuperresWeights& weights, const Kernels& kernels, const DecoderOptions& options)
    : kernels_(kernels), options_(options) {
  for (std::size_t i = 0; i < weights.query_channels.size(); ++i) {
    const std::string name = "query." + std::to_string(i);
    query_layers_.push_back({copied(weights.tensor(name + ".weight")), copied(weights.tensor(name + ".bias")),
                             norm_prelu_weights(weights, name)});
  }
  for (std::size_t level = 0; level < weights.channels.size(); ++level) {
    const std::string name = "decoder." + std::to_string(level);
    const int skip = weights.channels[level];
    const int in[2] = {level + 1 == weights.channels.size() ? weights.query_channels.back() : skip, skip};
    layers_.push_back({PackedConvolution::doubling(weights.tensor(name + ".conv.weight"),
                                                   weights.tensor(name + ".conv.bias"), in, kernels.number),
                       norm_prelu_weights(weights, name)});
  }

  const int channels = layers_.front().convolution.output_channels(), blocks = blocks_of(channels);
  const std::span<const float> picture = weights.tensor("output.0.conv.weight");
  picture_weights_.assign(std::size_t(9 * blocks * 3 * kLanes), 0.f);
  for (int o = 0; o < 3; ++o) {
    for (int c = 0; c < channels; ++c) {
      for (int ky = 0; ky < 3; ++ky) {
        for (int kx = 0; kx < 3; ++kx) {
          const int place = (((ky * blocks + c / kLanes) * 3 + kx) * 3 + o) * kLanes + c % kLanes;
          picture_weights_[std::size_t(place)] = picture[std::size_t(((o * channels + c) * 3 + ky) * 3 + kx)];
        }
      }
    }
  }
  std::copy_n(weights.tensor("output.0.conv.bias").begin(), 3, picture_bias_);
}

Decoder::~Decoder() = default;

// A workspace for one call, made where none of this size is idle.
class Decoder::Lease {
 public:
  Lease(const Decoder& decoder, int height, int width) : decoder_(decoder) {
    {
      const std::lock_guard lock(decoder.mutex_);
      auto& idle = decoder.idle_;
      const auto fits = [&](const auto& space) { return space->height == height && space->width == width; };
      const auto found = std::find_if(idle.begin(), idle.end(), fits);
      if (found != idle.end()) {
        space_ = std::move(*found);
        idle.erase(found);
      } else {
        idle.clear();  // of other sizes: pictures of one scan are all of one size
      }
    }
    if (space_ == nullptr) space_ = decoder.make_workspace(height, width);
  }
  ~Lease() {
    const std::lock_guard lock(decoder_.mutex_);
    decoder_.idle_.push_back(std::move(space_));
  }
  Lease(const Lease&) = delete;
  Lease& operator=(const Lease&) = delete;

  DecoderWorkspace& operator*() const { return *space_; }

 private:
  const Decoder& decoder_;
  std::unique_ptr<DecoderWorkspace> space_;
};

DecoderRowShape Decoder::row_shape(std::size_t level, int picture_width) const {
  const PackedConvolution& convolution = layers_[level].convolution;
  return {picture_width,
          picture_width >> (level + 1),
          convolution.input_blocks(),
          convolution.output_blocks(),
          layers_.front().convolution.output_blocks(),
          kernels_.number};
}

std::unique_ptr<DecoderWorkspace> Decoder::make_workspace(int height, int width) const {
  auto space = std::make_unique<DecoderWorkspace>();
  space->height = height;
  space->width = width;
  space->affine.resize(layers_.size());
  for (std::size_t level = 0; level < layers_.size(); ++level) {
    const PackedConvolution& convolution = layers_[level].convolution;
    const int h = height >> level, w = width >> level;
    space->outputs.push_back(FeatureMap::shape(h, w, convolution.output_channels(), Number::kFloat32));
    space->inputs.push_back(convolution.pairs() > 1
                                ? FeatureMap::shape(h / 2, w / 2, convolution.input_blocks() * kLanes, kernels_.number,
                                                    {.right = 1, .bottom = 1})
                                : FeatureMap());
    space->moments.emplace_back(std::size_t(convolution.pairs()) * bands(h / 2));
  }
  for (std::size_t level = 0; level < layers_.size(); ++level) {
    space->scratch_bytes = std::max(space->scratch_bytes, row_shape(level, width).bytes());
  }
  space->frugal = space->outputs.front().bytes() > options_.largest_map_bytes;
  return space;
}

std::vector<float> Decoder::query_features(const core::Direction& query) const {
  std::vector<float> x{float(query.x()), float(query.y()), float(query.z())};
  for (const QueryLayer& layer : query_layers_) {
    std::vector<double> sums(layer.bias.begin(), layer.bias.end());
    double mean = 0, variance = 0;
    for (std::size_t o = 0; o < sums.size(); ++o) {
      for (std::size_t i = 0; i < x.size(); ++i) sums[o] += double(layer.weight[o * x.size() + i]) * double(x[i]);
      mean += sums[o] / double(sums.size());
    }
    for (const double sum : sums) variance += (sum - mean) * (sum - mean) / double(sums.size());
    x.clear();
    for (std::size_t o = 0; o < sums.size(); ++o) {
      const double normalised = (sums[o] - mean) / std::sqrt(variance + kEpsilon);
      const double z = double(layer.norm.scale[o]) * normalised + double(layer.norm.shift[o]);
      x.push_back(float(z > 0 ? z : z * double(layer.norm.slope[o])));
    }
  }
  return x;
}

void Decoder::write_input_row(std::size_t level, int y, const WeightedEncodings& pooled, const DecoderWorkspace& space,
                              const Row& out) const {
  const int width = space.width >> (level + 1);
  const std::size_t pixel_bytes = kLanes * size_of(kernels_.number);
  std::byte* block = out.data;
  const auto finish_block = [&] {
    std::memset(block + std::size_t(width) * pixel_bytes, 0, pixel_bytes);
    block += out.block_bytes;
  };

  if (level + 1 == layers_.size()) {
    for (std::size_t first = 0; first < space.query.size(); first += kLanes, finish_block()) {
      const float* const lanes = space.query.data() + first;
      const void* const in[] = {lanes};
      const float one = 1;
      for (int x = 0; x < width; ++x) kernels_.pool_float(in, &one, 1, block + std::size_t(x) * pixel_bytes, 1);
    }
  } else {
    const ConstRow in = space.outputs[level + 1].row(y);
    const std::vector<BlockAffine>& affine = space.affine[level + 1];
    for (std::size_t b = 0; b < affine.size(); ++b, finish_block()) {
      kernels_.normalise(reinterpret_cast<const float*>(in.data + b * in.block_bytes), block, std::size_t(width),
                         affine[b]);
    }
  }

  std::array<const void*, kMostEncodings> in;
  std::size_t block_bytes = 0;
  for (std::size_t i = 0; i < pooled.encodings.size(); ++i) {
    const ConstRow row = pooled.encodings[i]->levels[level].row(y);
    in[i] = row.data;
    block_bytes = row.block_bytes;
  }
  const FeatureMap& any = pooled.encodings.front()->levels[level];
  const auto pool = any.number() == Number::kFloat32 ? kernels_.pool_float : kernels_.pool_float16;
  for (int b = 0; b < any.blocks(); ++b, finish_block()) {
    pool(in.data(), pooled.weights.data(), int(pooled.encodings.size()), block, std::size_t(width));
    for (std::size_t i = 0; i < pooled.encodings.size(); ++i)
      in[i] = static_cast<const std::byte*>(in[i]) + block_bytes;
  }
}

// Convolves input rows first to last - 1, one after the other, with two rows of input at a time; output rows 2y and 2y + 1 go to output(y,
// parity), then done(y) is called. For layers of one pair of output blocks.
template <class Output, class Done>
void Decoder::roll(std::size_t level, int first, int last, const WeightedEncodings& pooled,
                   const DecoderWorkspace& space, const DecoderRows& scratch, bool past_caches, Moments& moments,
                   const Output& output, const Done& done) const {
  const PackedConvolution& convolution = layers_[level].convolution;
  const int height = space.height >> (level + 1), width = space.width >> (level + 1);
  write_input_row(level, first, pooled, space, scratch.input(first));
  for (int y = first; y < last; ++y) {
    if (y + 1 < height) write_input_row(level, y + 1, pooled, space, scratch.input(y + 1));
    const ConstRow rows[2] = {scratch.input(y), y + 1 < height ? scratch.input(y + 1) : scratch.no_input(y + 1)};
    for (const PackedConvolution::Phase& phase : convolution.phases()) {
      convolution.run_row(kernels_, 0, phase, rows, width, output(y, phase.y), past_caches, moments);
    }
    done(y);
  }
}

void Decoder::decode_rolling(std::size_t level, const WeightedEncodings& pooled, DecoderWorkspace& space) const {
  const int height = space.height >> (level + 1);
  const FeatureMap& map = space.outputs[level];
  const bool past_caches = map.bytes() > kCachedBytes && !(space.frugal && level == 0);
  core::parallel_for(bands(height), 1, [&](std::size_t part, std::size_t) {
    const DecoderRows scratch(space, row_shape(level, space.width));
    const int first = int(part) * kBandRows;
    roll(
        level, first, std::min(height, first + kBandRows), pooled, space, scratch, past_caches,
        space.moments[level][part],
        [&](int y, int parity) {
          return space.frugal && level == 0 ? scratch.output(parity) : map.row(2 * y + parity);
        },
        [](int) {});
    if (past_caches) std::atomic_thread_fence(std::memory_order_seq_cst);
  });
}

void Decoder::decode_pairs(std::size_t level, const WeightedEncodings& pooled, DecoderWorkspace& space) const {
  const PackedConvolution& convolution = layers_[level].convolution;
  const FeatureMap &in = space.inputs[level], &out = space.outputs[level];
  core::parallel_for(std::size_t(in.height()), 1, [&](std::size_t y, std::size_t) {
    write_input_row(level, int(y), pooled, space, in.row(int(y)));
  });
  const std::size_t parts = bands(in.height());
  core::parallel_for(std::size_t(convolution.pairs()) * parts, 1, [&](std::size_t task, std::size_t) {
    const int first = int(task % parts) * kBandRows, last = std::min(in.height(), first + kBandRows);
    // The weights of one phase stay in the cache for all rows.
    for (const PackedConvolution::Phase& phase : convolution.phases()) {
      for (int y = first; y < last; ++y) {
        const ConstRow rows[2] = {in.row(y), in.row(y + 1)};
        convolution.run_row(kernels_, int(task / parts), phase, rows, in.width(), out.row(2 * y + phase.y),
                            /*past_caches=*/false, space.moments[level][task]);
      }
    }
  });
}

void Decoder::paint(const WeightedEncodings& pooled, DecoderWorkspace& space, core::Image& picture) const {
  const FeatureMap& map = space.outputs.front();
  const std::vector<BlockAffine>& affine = space.affine.front();
  const int height = space.height, width = space.width;
  const std::size_t block_floats = row_shape(0, width).picture_block_floats();
  core::parallel_for(bands(height / 2), 1, [&](std::size_t part, std::size_t) {
    const DecoderRows scratch(space, row_shape(0, width));
    const float* const outside = scratch.no_picture();
    const int first = int(part) * 2 * kBandRows, last = std::min(height, first + 2 * kBandRows);
    const auto paint_row = [&](int y) {
      const PictureRow row{{y > 0 ? scratch.picture(y - 1) : outside, scratch.picture(y),
                            y + 1 < height ? scratch.picture(y + 1) : outside},
                           block_floats,
                           int(affine.size()),
                           picture_weights_.data(),
                           picture_bias_,
                           width,
                           picture.pixel(y, 0)};
      kernels_.picture(row);
    };
    // Takes rows in order and paints those before them.
    const auto accept = [&](int y, const ConstRow& in) {
      float* out = scratch.picture(y);
      for (std::size_t b = 0; b < affine.size(); ++b, out += block_floats) {
        kernels_.normalise_to_float(reinterpret_cast<const float*>(in.data + b * in.block_bytes), out + kLanes,
                                    std::size_t(width), affine[b]);
        std::fill_n(out, kLanes, 0.f);
        std::fill_n(out + std::size_t(width + 1) * kLanes, kLanes, 0.f);
      }
      if (y > first) paint_row(y - 1);
    };

    const int from = std::max(0, first - 1), to = std::min(height, last + 1);
    if (!space.frugal) {
      for (int y = from; y < to; ++y) accept(y, map.row(y));
    } else {
      Moments ignored;
      roll(
          0, from / 2, (to + 1) / 2, pooled, space, scratch, /*past_caches=*/false, ignored,
          [&](int, int parity) { return scratch.output(parity); },
          [&](int y) {
            for (const int parity : {0, 1}) {
              if (2 * y + parity >= from && 2 * y + parity < to) accept(2 * y + parity, scratch.output(parity));
            }
          });
    }
    if (last == height) paint_row(height - 1);
  });
}

core::Image Decoder::decode(const WeightedEncodings& pooled, const core::Direction& query) const {
  // The farthest of the active set weighs nothing: not even read.
  WeightedEncodings read{{}, {}, pooled.done};
  for (std::size_t i = 0; i < pooled.encodings.size(); ++i) {
    if (pooled.weights[i] == 0) continue;
    read.encodings.push_back(pooled.encodings[i]);
    read.weights.push_back(pooled.weights[i]);
  }
  if (read.encodings.empty() || read.encodings.size() > kMostEncodings) {
    throw std::logic_error("a picture is made of 1 to 64 encodings");
  }
  const FeatureMap& finest = read.encodings.front()->levels.front();
  const Lease lease(*this, 2 * finest.height(), 2 * finest.width());
  DecoderWorkspace& space = *lease;
  space.query = query_features(query);
  space.query.resize(std::size_t(round_up(int(space.query.size()), kLanes)), 0.f);
  for (std::size_t level = layers_.size(); level-- > 0;) {
    space.begin_level(level);
    std::fill(space.moments[level].begin(), space.moments[level].end(), Moments());
    if (layers_[level].convolution.pairs() == 1) {
      decode_rolling(level, read, space);
    } else {
      decode_pairs(level, read, space);
    }
    space.affine[level] = group_norm(space.moments[level], bands(space.height >> (level + 1)), layers_[level].norm);
    if (level == 0) break;  // still read for the picture
    space.end_level(level);
    if (read.done) read.done(level);
  }
  core::Image picture(space.height, space.width, 3);
  paint(read, space, picture);
  space.end_level(0);
  if (read.done) read.done(0);
  return picture;
}

}  // namespace lightstage::model
