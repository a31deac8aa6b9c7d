#include "db/store/page_sum.h"

#include <algorithm>
#include <bit>
#include <string_view>

#include <xxhash.h>

#include "db/store/migrations.h"

namespace lightstage::db {

namespace {

void put_big_endian(std::span<unsigned char> place, std::uint32_t value) {
  for (std::size_t i = place.size(); i-- > 0; value >>= 8) place[i] = static_cast<unsigned char>(value & 0xff);
}

}  // namespace

std::array<unsigned char, kPageSumBytes> page_sum(std::span<const unsigned char> page, std::uint64_t number) {
  XXH64_canonical_t canonical;
  XXH64_canonicalFromHash(&canonical, XXH3_64bits_withSeed(page.data(), page.size() - kPageSumBytes, number));
  return std::to_array(canonical.digest);
}

bool page_matches(std::span<const unsigned char> page, std::uint64_t number) {
  return std::ranges::equal(page_sum(page, number), page.last(kPageSumBytes));
}

bool mend_page(std::span<unsigned char> page, std::uint64_t number) {
  const std::span<unsigned char> stored = page.last(kPageSumBytes);
  const auto sum = page_sum(page, number);
  int differing = 0;
  for (std::size_t i = 0; i < kPageSumBytes; ++i) {
    differing += std::popcount(static_cast<unsigned char>(sum[i] ^ stored[i]));
  }
  if (differing <= 1) {
    std::copy(sum.begin(), sum.end(), stored.begin());
    return true;
  }
  for (unsigned char& byte : page.first(page.size() - kPageSumBytes)) {
    for (int bit = 0; bit < 8; ++bit) {
      byte = static_cast<unsigned char>(byte ^ 1U << bit);
      if (page_matches(page, number)) return true;
      byte = static_cast<unsigned char>(byte ^ 1U << bit);
    }
  }
  return false;
}

void put_known_header(std::span<unsigned char> page, std::size_t pages) {
  constexpr std::string_view kMagic("SQLite format 3\0", 16);
  std::copy(kMagic.begin(), kMagic.end(), page.begin());
  put_big_endian(page.subspan(16, 2), page.size() == 65536 ? 1 : std::uint32_t(page.size()));
  page[18] = page[19] = 2;  // written and read with a write-ahead log
  page[20] = kPageSumBytes;
  page[21] = 64;  // shares of a page that a row may take, which no version of SQLite changes
  page[22] = page[23] = 32;
  put_big_endian(page.subspan(28, 4), std::uint32_t(pages));
  put_big_endian(page.subspan(44, 4), 4);  // the schema's format
  put_big_endian(page.subspan(48, 4), 0);
  put_big_endian(page.subspan(52, 4), 0);  // no automatic vacuum
  put_big_endian(page.subspan(56, 4), 1);  // UTF-8
  put_big_endian(page.subspan(60, 4), std::uint32_t(schema_version()));
  put_big_endian(page.subspan(64, 4), 0);
  put_big_endian(page.subspan(68, 4), std::uint32_t(kApplicationId));
  std::ranges::fill(page.subspan(72, 20), static_cast<unsigned char>(0));
}

}  // namespace lightstage::db
