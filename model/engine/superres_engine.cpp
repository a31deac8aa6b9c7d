#include "model/engine/superres_engine.h"

#include <algorithm>
#include <utility>

#include "core/error.h"
#include "core/parallel.h"

namespace lightstage::model {
namespace {

// sum += weight * map
void accumulate(FeatureMap& sum, const FeatureMap& map, float weight) {
  const Kernels& kernels = float_kernels();
  const auto scale = map.number() == Number::kFloat32 ? kernels.pool_float : kernels.pool_float16;
  constexpr std::size_t kRows = 8;
  core::parallel_for(std::size_t(map.height()), kRows, [&](std::size_t first, std::size_t last) {
    std::vector<float> scaled(std::size_t(map.width()) * kLanes);
    for (int y = int(first); y < int(last); ++y) {
      const Row to = sum.row(y);
      const ConstRow from = map.row(y);
      for (std::size_t b = 0; b < std::size_t(map.blocks()); ++b) {
        const void* const term = from.data + b * from.block_bytes;
        std::byte* const total = to.data + b * to.block_bytes;
        scale(&term, &weight, 1, scaled.data(), std::size_t(map.width()));
        const void* const terms[] = {total, scaled.data()};
        const float ones[] = {1, 1};
        kernels.pool_float(terms, ones, 2, total, std::size_t(map.width()));
      }
    }
  });
}

// Memory that does not hold an active set would be written over before it is read.
EncodingBudget usable(EncodingBudget budget, bool holds_active_set) {
  if (!holds_active_set) budget.memory_bytes = 0;
  return budget;
}

}  // namespace

const Kernels& kernels_for(Number products) {
  if (products == Number::kFloat32) return float_kernels();
  const Kernels* const kernels = bfloat_kernels();
  if (kernels == nullptr) {
    throw core::UsageError("this processor has no bfloat16 instructions (avx512_bf16): leave bf16 out");
  }
  return *kernels;
}

SuperresEngine::SuperresEngine(const SuperresWeights& weights, core::ImageSize size,
                               std::vector<core::Direction> lights, LoadImage load, const EngineOptions& options)
    : lights_(std::move(lights)),
      load_(std::move(load)),
      size_(size),
      options_(options),
      encoder_(weights),
      decoder_(weights, kernels_for(options.products), options.decoder),
      holds_active_set_(encoding_bytes(weights.channels, size, options.storage) <=
                        options.budget.memory_bytes / std::min(std::size_t(weights.neighbours), lights_.size())),
      holds_one_(encoding_bytes(weights.channels, size, options.storage) <= options.budget.spill_bytes),
      cache_(usable(options.budget, holds_active_set_)) {}

EncodingCache::Pointer SuperresEngine::encoding(std::size_t light) const {
  if (EncodingCache::Pointer found = cache_.find(light)) return found;
  auto made = std::make_shared<const Encoding>(encoder_.encode(load_(light), lights_[light], options_.storage));
  cache_.keep(light, made);
  return made;
}

Encoding SuperresEngine::pooled(std::span<const std::size_t> active, std::span<const float> weights) const {
  Encoding sum;
  for (std::size_t level = 0; level < encoder_.levels(); ++level) {
    const FeatureMap shape = encoder_.level_shape(level, size_, Number::kFloat32);
    sum.levels.emplace_back(shape, Pages(shape.bytes()));
  }
  for (std::size_t i = 0; i < active.size(); ++i) {
    if (weights[i] == 0) continue;
    const auto add = [&](std::size_t level, const FeatureMap& map) { accumulate(sum.levels[level], map, weights[i]); };
    if (holds_one_) {
      const EncodingCache::Pointer kept = encoding(active[i]);
      for (std::size_t level = 0; level < kept->levels.size(); ++level) add(level, kept->levels[level]);
    } else {
      encoder_.encode(load_(active[i]), lights_[active[i]],
                      [&](std::size_t level, const FeatureMap& map) { add(level, map); });
    }
  }
  return sum;
}

core::Image SuperresEngine::render(const core::Direction& query, std::span<const std::size_t> active,
                                   std::span<const float> weights) const {
  WeightedEncodings terms;
  std::vector<EncodingCache::Pointer> held;
  Encoding sum;
  if (!holds_active_set_) {
    sum = pooled(active, weights);
    terms = {{&sum}, {1.f}, [&sum](std::size_t level) { sum.levels[level].release(); }};
  } else {
    for (std::size_t i = 0; i < active.size(); ++i) {
      if (weights[i] == 0) continue;
      held.push_back(encoding(active[i]));
      terms.encodings.push_back(held.back().get());
      terms.weights.push_back(weights[i]);
    }
  }
  return decoder_.decode(terms, query);
}

}  // namespace lightstage::model
