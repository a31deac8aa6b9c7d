#include "db/content_hash.h"

#include <fstream>
#include <memory>
#include <vector>

#include <xxhash.h>

#include "core/error.h"
#include "core/printable.h"

namespace lightstage::db {
namespace {

ContentHash canonical(const XXH128_hash_t& hash) {
  XXH128_canonical_t canonical;
  XXH128_canonicalFromHash(&canonical, hash);
  ContentHash result;
  std::copy(std::begin(canonical.digest), std::end(canonical.digest), result.bytes.begin());
  return result;
}

int hex_value(char digit) {
  if (digit >= '0' && digit <= '9') return digit - '0';
  if (digit >= 'a' && digit <= 'f') return digit - 'a' + 10;
  if (digit >= 'A' && digit <= 'F') return digit - 'A' + 10;
  return -1;
}

}  // namespace

std::string ContentHash::hex() const {
  constexpr std::string_view kDigits = "0123456789abcdef";
  std::string text;
  text.reserve(2 * bytes.size());
  for (const std::uint8_t byte : bytes) {
    text += kDigits[byte >> 4];
    text += kDigits[byte & 15];
  }
  return text;
}

ContentHash ContentHash::from_hex(std::string_view text) {
  ContentHash hash;
  bool sound = text.size() == 2 * hash.bytes.size();
  for (std::size_t i = 0; sound && i < hash.bytes.size(); ++i) {
    const int high = hex_value(text[2 * i]);
    const int low = hex_value(text[2 * i + 1]);
    sound = high >= 0 && low >= 0;
    hash.bytes[i] = std::uint8_t(16 * high + low);
  }
  if (!sound) throw core::StoreError(core::quoted(text) + " is not an object's name (32 hexadecimal digits)");
  return hash;
}

ContentHash hash_bytes(std::span<const std::uint8_t> bytes) {
  return canonical(XXH3_128bits(bytes.data(), bytes.size()));
}

ContentHash hash_file(const std::filesystem::path& path) {
  std::error_code error;
  // A folder opens as a stream too, and reads as if it were empty.
  if (!std::filesystem::is_regular_file(path, error)) {
    throw core::StoreError(path.string() + ": cannot be read: not there or not a file");
  }
  std::ifstream file(path, std::ios::binary);
  const std::unique_ptr<XXH3_state_t, XXH_errorcode (*)(XXH3_state_t*)> state(XXH3_createState(), &XXH3_freeState);
  if (state == nullptr) throw std::bad_alloc();
  XXH3_128bits_reset(state.get());
  std::vector<char> block(std::size_t(1) << 20);
  while (file) {
    file.read(block.data(), std::streamsize(block.size()));
    XXH3_128bits_update(state.get(), block.data(), std::size_t(file.gcount()));
  }
  if (!file.eof()) throw core::StoreError(path.string() + ": cannot be read");
  return canonical(XXH3_128bits_digest(state.get()));
}

}  // namespace lightstage::db
