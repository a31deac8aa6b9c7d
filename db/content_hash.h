// The name of an object: the XXH3 128-bit hash of its file's bytes.
#pragma once

#include <array>
#include <compare>
#include <cstdint>
#include <filesystem>
#include <span>
#include <string>
#include <string_view>

namespace lightstage::db {

struct ContentHash {
  std::array<std::uint8_t, 16> bytes{};  // canonical (big-endian) order
  auto operator<=>(const ContentHash&) const = default;

  std::string hex() const;                             // 32 lower-case digits
  static ContentHash from_hex(std::string_view text);  // throws StoreError when it is not 32 hexadecimal digits
};

ContentHash hash_bytes(std::span<const std::uint8_t> bytes);
// Streams the file; throws StoreError when it cannot be read.
ContentHash hash_file(const std::filesystem::path& path);

}  // namespace lightstage::db
