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
  // What convolutions multiply, kFloat32 or kBfloat16; sums are float32 always. kBfloat16 throws UsageError where the processor has no
  // instructions for it.
  Number products = Number::kFloat32;
  // What encodings are kept in, kFloat32 or kFloat16; the latter works on every processor.
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
  // every thread count. Where the budget's memory does not hold the encodings of an active set they are pooled one after the other as they
  // are made, or read from the file: at the first level's 32 channels and 4096 x 4096 pixels this takes 1 GB for the sums and at most as
  // much beside them.
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
  bool holds_active_set_;
  bool holds_one_;  // in the file, where memory does not hold an active set
  mutable EncodingCache cache_;
};

// The kernels that compute with such products; throws as above.
const Kernels& kernels_for(Number products);

}  // namespace lightstage::model
