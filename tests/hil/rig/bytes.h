// Numbers in the little-endian order of USB.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

namespace lightstage::hil {

using Bytes = std::vector<std::uint8_t>;
using ByteView = std::span<const std::uint8_t>;

inline void append(Bytes& bytes, std::uint32_t value, int width) {
  for (int i = 0; i < width; ++i) bytes.push_back(static_cast<std::uint8_t>(value >> (8 * i)));
}

inline void append(Bytes& bytes, ByteView more) {
  bytes.insert(bytes.end(), more.begin(), more.end());
}

// The first `width` bytes as a number; those that are missing count as 0.
inline std::uint32_t number(ByteView bytes, std::size_t width) {
  std::uint32_t value = 0;
  for (std::size_t i = 0; i < width && i < bytes.size(); ++i) value |= std::uint32_t{bytes[i]} << (8 * i);
  return value;
}

}  // namespace lightstage::hil
