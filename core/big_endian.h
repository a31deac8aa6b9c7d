// Numbers as PNG, SQLite and networks write them.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

namespace lightstage::core {

// Four bytes from `at` on, the highest first.
inline std::uint32_t big_endian_32(std::span<const unsigned char> bytes, std::size_t at = 0) {
  return std::uint32_t(bytes[at]) << 24 | std::uint32_t(bytes[at + 1]) << 16 | std::uint32_t(bytes[at + 2]) << 8 |
         std::uint32_t(bytes[at + 3]);
}

}  // namespace lightstage::core
