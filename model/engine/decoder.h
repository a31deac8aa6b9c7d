// The decoder half of the engine: from the encodings of the active set to the picture of a query.
#pragma once

#include <functional>
#include <memory>
#include <mutex>
#include <span>
#include <vector>

#include "core/direction.h"
#include "core/image.h"
#include "model/engine/convolution.h"
#include "model/engine/encoder.h"
#include "model/engine/normalisation.h"
#include "model/engine/weights.h"

namespace lightstage::model {

// sum_i weights[i] encodings[i], computed row by row where it is needed and never stored.
struct WeightedEncodings {
  std::vector<const Encoding*> encodings;  // all of one size and number format
  std::vector<float> weights;
  // Called, where set, when a level will not be read any more: its memory may go.
  std::function<void(std::size_t level)> done;
};

struct DecoderOptions {
  // Where the last feature map would take more than this (it is twice as large as everything else together) it is computed twice, first for
  // its statistics, then for the picture, and no memory is kept between queries.
  std::size_t largest_map_bytes = std::size_t(1) << 30;
};

struct DecoderWorkspace;
struct DecoderRowShape;
class DecoderRows;

class Decoder {
 public:
  // The kernels decide whether products are taken in float32 or bfloat16.
  Decoder(const SuperresWeights& weights, const Kernels& kernels, const DecoderOptions& options = {});
  ~Decoder();

  // Display-encoded, 3 channels, in (0, 1), twice the size of the encodings' first level. May be called from several threads, each of which
  // takes memory of its own; once it has been called for a size, nothing is allocated but the picture. Does not depend on the
  // thread count.
  core::Image decode(const WeightedEncodings& pooled, const core::Direction& query) const;

 private:
  struct Layer {
    PackedConvolution convolution;
    NormPreluWeights norm;
  };
  struct QueryLayer {
    std::vector<float> weight, bias;
    NormPreluWeights norm;
  };
  class Lease;

  DecoderRowShape row_shape(std::size_t level, int picture_width) const;
  std::unique_ptr<DecoderWorkspace> make_workspace(int height, int width) const;
  std::vector<float> query_features(const core::Direction& query) const;
  // The input of a level's convolution, row y: what the level below made (of the coarsest: the query), then the pooled encodings.
  void write_input_row(std::size_t level, int y, const WeightedEncodings& pooled, const DecoderWorkspace& space,
                       const Row& out) const;
  template <class Output, class Done>
  void roll(std::size_t level, int first, int last, const WeightedEncodings& pooled, const DecoderWorkspace& space,
            const DecoderRows& scratch, bool past_caches, Moments& moments, const Output& output,
            const Done& done) const;
  // Fine levels have many pixels, few weights: a few rows of input at a time, made where they are used. Coarse ones the reverse: all input
  // first, then one pair of output blocks after the other, so that weights are read once.
  void decode_rolling(std::size_t level, const WeightedEncodings& pooled, DecoderWorkspace& space) const;
  void decode_pairs(std::size_t level, const WeightedEncodings& pooled, DecoderWorkspace& space) const;
  // The last normalisation, the 3x3 convolution to three colours and the sigmoid.
  void paint(const WeightedEncodings& pooled, DecoderWorkspace& space, core::Image& picture) const;

  const Kernels& kernels_;
  DecoderOptions options_;
  std::vector<QueryLayer> query_layers_;
  std::vector<Layer> layers_;  // by level
  std::vector<float> picture_weights_;
  float picture_bias_[3];
  mutable std::mutex mutex_;
  mutable std::vector<std::unique_ptr<DecoderWorkspace>> idle_;
};

}  // namespace lightstage::model
