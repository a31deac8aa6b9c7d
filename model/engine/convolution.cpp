#include "model/engine/convolution.h"

#include <algorithm>
#include <cstring>
#include <numeric>

namespace lightstage::model {
namespace {

std::uint32_t bits_of(float value) {
  std::uint32_t bits;
  std::memcpy(&bits, &value, sizeof bits);
  return bits;
}

Bfloat16 rounded(float value) {
  const std::uint32_t bits = bits_of(value);
  return Bfloat16((bits + 0x7fff + ((bits >> 16) & 1)) >> 16);
}

}  // namespace

PackedConvolution PackedConvolution::halving(std::span<const float> weight, std::span<const float> bias, int in,
                                             Number number) {
  PackedConvolution packed;
  packed.stride_ = 2;
  packed.bias_.assign(bias.begin(), bias.end());
  Phase phase{0, 0, {}};
  for (int ky = 0; ky < 3; ++ky) {
    for (int kx = 0; kx < 3; ++kx) phase.taps.push_back({ky, kx - 1, ky, kx});
  }
  packed.phases_ = {phase};
  packed.pack(std::span(&in, 1), number,
              [&](int o, int i, int ky, int kx) { return weight[std::size_t(((o * in + i) * 3 + ky) * 3 + kx)]; });
  return packed;
}

PackedConvolution PackedConvolution::doubling(std::span<const float> weight, std::span<const float> bias,
                                              std::span<const int> in, Number number) {
  PackedConvolution packed;
  packed.bias_.assign(bias.begin(), bias.end());
  // Input i meets output 2i + k - 1: an even output has tap 1 of its own input, an odd one tap 2 of it and tap 0 of the next.
  struct Reach {
    int d, k;
  };
  const std::vector<Reach> reach[2] = {{{0, 1}}, {{0, 2}, {1, 0}}};
  for (int y = 0; y < 2; ++y) {
    for (int x = 0; x < 2; ++x) {
      Phase phase{y, x, {}};
      for (const Reach& row : reach[y]) {
        for (const Reach& column : reach[x]) phase.taps.push_back({row.d, column.d, row.k, column.k});
      }
      packed.phases_.push_back(phase);
    }
  }
  const int out = int(bias.size());
  packed.pack(in, number,
              [&](int o, int i, int ky, int kx) { return weight[std::size_t(((i * out + o) * 3 + ky) * 3 + kx)]; });
  return packed;
}

void PackedConvolution::pack(std::span<const int> in, Number number, const Weight& weight) {
  output_channels_ = int(bias_.size());
  bias_.resize(std::size_t(pairs()) * 2 * kLanes, 0.f);
  std::vector<int> channel_of;  // by lane of the input; -1 where there is none
  int first = 0;
  for (const int channels : in) {
    for (int lane = 0; lane < blocks_of(channels) * kLanes; ++lane) {
      channel_of.push_back(lane < channels ? first + lane : -1);
    }
    first += channels;
  }
  input_blocks_ = int(channel_of.size()) / kLanes;
  const int per_word = number == Number::kFloat32 ? 1 : 2;
  // Channels that are not there need not be multiplied where there is but one block.
  words_ = (input_blocks_ == 1 ? std::min(first, kLanes) + per_word - 1 : kLanes) / per_word;

  std::size_t taps = 0;
  for (const Phase& phase : phases_) taps += phase.taps.size();
  weights_ = Pages(taps * std::size_t(output_blocks() * input_blocks_ * words_ * kLanes) * sizeof(float));
  std::byte* next = weights_.data();
  for (int pair = 0; pair < pairs(); ++pair) {
    const int blocks = std::min(2, output_blocks() - 2 * pair);
    for (const Phase& phase : phases_) {
      offsets_.push_back(std::size_t(next - weights_.data()));
      for (int b = 0; b < input_blocks_; ++b) {
        for (const Tap& tap : phase.taps) {
          for (int word = 0; word < words_; ++word) {
            for (int lane = 0; lane < blocks * kLanes; ++lane) {
              for (int part = 0; part < per_word; ++part) {
                const int o = pair * 2 * kLanes + lane;
                const int i = channel_of[std::size_t(b * kLanes + word * per_word + part)];
                const float value = o < output_channels_ && i >= 0 ? weight(o, i, tap.ky, tap.kx) : 0.f;
                if (number == Number::kFloat32) {
                  std::memcpy(next, &value, sizeof value);
                } else {
                  const Bfloat16 half = rounded(value);
                  std::memcpy(next, &half, sizeof half);
                }
                next += size_of(number);
              }
            }
          }
        }
      }
    }
  }
}

void PackedConvolution::run_row(const Kernels& kernels, int pair, const Phase& phase, const ConstRow* rows, int width,
                                const Row& out, bool past_caches, Moments& moments) const {
  const std::size_t pixel_bytes = kLanes * size_of(kernels.number);
  const int blocks = std::min(2, output_blocks() - 2 * pair);
  const int step = phases_.size() == 1 ? 1 : 2;  // between output pixels
  ConvolutionRun run;
  run.tap_count = int(phase.taps.size());
  run.input_blocks = input_blocks_;
  run.input_block_bytes = rows[0].block_bytes;
  run.words = words_;
  run.weights = weights(pair, phase);
  run.bias = bias_.data() + pair * 2 * kLanes;
  run.output_block_bytes = out.block_bytes;
  run.output_pixel_bytes = std::size_t(step) * kLanes * sizeof(float);
  run.moments = &moments;
  run.past_caches = past_caches;
  std::byte* const first =
      out.data + std::size_t(2 * pair) * out.block_bytes + std::size_t(phase.x) * kLanes * sizeof(float);

  // Runs of nearly equal length: a short one at the end would keep the multipliers waiting for each other.
  const int runs = (width + kernels.widest_run - 1) / kernels.widest_run;
  for (int n = 0; n < runs; ++n) {
    const int x = n * width / runs, next = (n + 1) * width / runs;
    for (std::size_t t = 0; t < phase.taps.size(); ++t) {
      const PackedConvolution::Tap& tap = phase.taps[t];
      run.taps[t] = rows[tap.dy].data + (x * stride_ + tap.dx) * std::ptrdiff_t(pixel_bytes);
    }
    run.output = reinterpret_cast<float*>(first + std::size_t(x) * run.output_pixel_bytes);
    kernels.convolve[stride_ - 1][blocks - 1][next - x - 1](run);
  }
}

}  // namespace lightstage::model
