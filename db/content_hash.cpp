#include "db/content_hash.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <memory>
#include <vector>

#include <xxhash.h>

#include "core/error.h"
#include "core/file_descriptor.h"
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
  // Not blocking, so that a pipe is refused and not waited for.
  const core::FileDescriptor file(::open(path.c_str(), O_RDONLY | O_NONBLOCK | O_CLOEXEC));
  struct stat status {};
  if (!file.is_open() || ::fstat(file.get(), &status) != 0 || !S_ISREG(status.st_mode)) {
    throw core::StoreError(path.string() + ": cannot be read: not there or not a file");
  }
  const std::unique_ptr<XXH3_state_t, XXH_errorcode (*)(XXH3_state_t*)> state(XXH3_createState(), &XXH3_freeState);
  if (state == nullptr) throw std::bad_alloc();
  XXH3_128bits_reset(state.get());
  std::vector<unsigned char> block(std::size_t(1) << 20);
  for (;;) {
    const ssize_t count = ::read(file.get(), block.data(), block.size());
    if (count < 0 && errno == EINTR) continue;
    if (count < 0) throw core::StoreError(path.string() + ": cannot be read: " + std::strerror(errno));
    if (count == 0) return canonical(XXH3_128bits_digest(state.get()));
    XXH3_128bits_update(state.get(), block.data(), std::size_t(count));
  }
}

}  // namespace lightstage::db
