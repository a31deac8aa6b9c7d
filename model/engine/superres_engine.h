// The published network for one scan, fast: every captured image is encoded once, a query then costs pooling and decoding.
// docs/engine.md says how and how fast.
#pragma once

#include <cstddef>
#include <functional>
#include <span>
#include <vector>

#include "core/direction.h"
#include "core/image.h"
#include "model/engine/decoder.h"
#include "model/engine/encoder.h"
#include "model/engine/encoding_cache.h"
#include "model/engine/weights.h"

namespace lightstage::model {

struct EngineOptions {
  // What convolutions multiply; sums are float32 always. kBfloat16 throws UsageError where the processor has no instructions for it.
  Number products = Number::kFloat32;
  // What encodings are kept in.
  Number storage = Number::kFloat32;
  EncodingBudget budget;
  DecoderOptions decoder;
};

class SuperresEngine {
 public:
  // The captured image of a light: display-encoded, 3 channels, always of one size, a multiple of 2^levels. Called from the thread that calls
  // render.
  using LoadImage = std::function<core::Image(std::size_t light)>;

  SuperresEngine(const SuperresWeights& weights, core::ImageSize size, std::vector<core::Direction> lights,
                 LoadImage load, const EngineOptions& options = {});

  // The picture of a query, display-encoded, from the active set (indices into the lights) and the weights of its members; those that weigh
  // nothing are not even loaded. May be called from several threads. The same, to float rounding, whatever is cached, and bit by bit for
  // every thread count. Where the encodings of the active set do not fit the budget's memory they are pooled one after the other, which
  // takes about 37 numbers a pixel for 32 channels at the first level; otherwise they stay in memory until the budget is spent.
  core::Image render(const core::Direction& query, std::span<const std::size_t> active,
                     std::span<const float> weights) const;

 private:
  EncodingCache::Pointer encoding(std::size_t light) const;
  Encoding pooled(std::span<const std::size_t> active, std::span<const float> weights) const;

  std::vector<core::Direction> lights_;
  LoadImage load_;
  core::ImageSize size_;
  EngineOptions options_;
  Encoder encoder_;
  Decoder decoder_;
  std::size_t encoding_bytes_;
  mutable EncodingCache cache_;
};

// The kernels that compute with such products; throws as above.
const Kernels& kernels_for(Number products);

}  // namespace lightstage::model
