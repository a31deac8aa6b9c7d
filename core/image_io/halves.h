// float32 to half (IEEE 754 binary16), many at a time.
#pragma once

#include <cstdint>
#include <span>

namespace lightstage::core::image_io {

// Rounds to nearest, ties to even, after clamping to +-65504; `halves` is as long as `values`. False when a value is not finite (what then
// stands in `halves` is of no use). By the processor's F16C instructions where it has them, some 5 GB of floats a second; else by to_halves_portably,
// which gives the same bits and is the reference.
bool to_halves(std::span<const float> values, std::span<std::uint16_t> halves);
bool to_halves_portably(std::span<const float> values, std::span<std::uint16_t> halves);

}  // namespace lightstage::core::image_io
