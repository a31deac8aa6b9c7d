// 3x3 convolutions of stride 2, up and down, on rows of feature maps.
#pragma once

#include <functional>
#include <span>
#include <vector>

#include "model/engine/feature_map.h"
#include "model/engine/kernels.h"

namespace lightstage::model {

// Weights in the order in which the kernels read them, for pairs of blocks of output channels.
class PackedConvolution {
 public:
  // Which input of the output pixel's place a weight meets: row dy of those given, pixel dx from its own.
  struct Tap {
    int dy, dx, ky, kx;
  };
  // The output pixels of one parity in y and x: of a transposed convolution; an ordinary one has a single phase.
  struct Phase {
    int y, x;
    std::vector<Tap> taps;
  };

  // conv2d, stride 2, padding 1; weight [out, in, 3, 3]. Output row y reads input rows 2y - 1, 2y, 2y + 1.
  static PackedConvolution halving(std::span<const float> weight, std::span<const float> bias, int in, Number number);
  // conv_transpose2d, stride 2, padding 1, output padding 1; weight [in, out, 3, 3]. Output rows 2y and 2y + 1 read input rows y and
  // y + 1. The input consists of maps of so many channels each, whose blocks follow each other.
  static PackedConvolution doubling(std::span<const float> weight, std::span<const float> bias, std::span<const int> in,
                                    Number number);

  int output_channels() const { return output_channels_; }
  int output_blocks() const { return blocks_of(output_channels_); }
  int pairs() const { return (output_blocks() + 1) / 2; }
  int input_blocks() const { return input_blocks_; }
  const std::vector<Phase>& phases() const { return phases_; }
  std::size_t weight_bytes() const { return weights_.size(); }

  // One row of output pixels of one pair of blocks and one phase. `rows` are the input rows by dy; `out` is the whole output row, float32, of
  // `width` pixels of this phase; `past_caches` as in ConvolutionRun.
  void run_row(const Kernels& kernels, int pair, const Phase& phase, const ConstRow* rows, int width, const Row& out,
               bool past_caches, Moments& moments) const;

 private:
  // weight(o, i, ky, kx), o and i channels
  using Weight = std::function<float(int, int, int, int)>;
  void pack(std::span<const int> in, Number number, const Weight& weight);
  const void* weights(int pair, const Phase& phase) const {
    return weights_.data() + offsets_[std::size_t(pair) * phases_.size() + std::size_t(&phase - phases_.data())];
  }

  int stride_ = 1;
  int output_channels_ = 0, input_blocks_ = 0, words_ = 0;
  std::vector<Phase> phases_;
  Pages weights_;
  std::vector<std::size_t> offsets_;  // in bytes, by pair and phase
  std::vector<float> bias_;
};

}  // namespace lightstage::model
