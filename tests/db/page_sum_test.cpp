#include "db/store/page_sum.h"

#include <catch2/catch.hpp>

#include <random>

using namespace lightstage;

namespace {

std::vector<unsigned char> page_of(std::size_t size, std::uint64_t number) {
  std::mt19937 random{unsigned(number)};
  std::vector<unsigned char> page(size);
  for (unsigned char& byte : page) byte = static_cast<unsigned char>(random());
  const auto sum = db::page_sum(page, number);
  std::copy(sum.begin(), sum.end(), page.end() - std::ptrdiff_t(sum.size()));
  return page;
}

}  // namespace

TEST_CASE("a page matches its checksum, its number and no other") {
  const auto page = page_of(4096, 3);
  CHECK(db::page_matches(page, 3));
  CHECK_FALSE(db::page_matches(page, 4));
}

TEST_CASE("one flipped bit of a page is put right, wherever it is; two are left as they are") {
  std::mt19937 random(1);
  for (const std::size_t size : {std::size_t{512}, std::size_t{4096}}) {
    const auto sound = page_of(size, 9);
    for (int i = 0; i < 40; ++i) {
      // The first and the last bits of both parts, and others.
      const std::size_t parts[] = {0, size * 8 - 64, size * 8 - 1, size * 8 - 65};
      const std::size_t bit = i < 4 ? parts[i] : random() % (size * 8);
      auto page = sound;
      page[bit / 8] = static_cast<unsigned char>(page[bit / 8] ^ 1U << bit % 8);
      CHECK(db::mend_page(page, 9));
      CHECK(page == sound);
    }
    auto twice = sound;
    twice[5] ^= 1;
    twice[400] ^= 0x80;
    const auto damaged = twice;
    CHECK_FALSE(db::mend_page(twice, 9));
    CHECK(twice == damaged);
  }
}
