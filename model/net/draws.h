// Random numbers of training draws: by seed, purpose and number of the draw.
#pragma once

#include <cstdint>
#include <random>

namespace lightstage::model {

enum class Stream : std::uint32_t { kTraining, kValidation };

inline std::mt19937_64 draw_generator(std::uint64_t seed, Stream stream, std::int64_t number) {
  const auto low = [](std::uint64_t v) { return std::uint32_t(v); };
  const auto high = [](std::uint64_t v) { return std::uint32_t(v >> 32); };
  std::seed_seq sequence{low(seed), high(seed), std::uint32_t(stream), low(std::uint64_t(number)),
                         high(std::uint64_t(number))};
  return std::mt19937_64(sequence);
}

}  // namespace lightstage::model
