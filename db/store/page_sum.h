// The checksum at the end of a page of the catalogue, and what can be put right by it.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>

namespace lightstage::db {

inline constexpr std::size_t kPageSumBytes = 8;

// Of all bytes of the page but the last eight, with the page's number (from 1) as seed: XXH3, 64 bits, big-endian.
std::array<unsigned char, kPageSumBytes> page_sum(std::span<const unsigned char> page, std::uint64_t number);

// Whether the last eight bytes are that.
bool page_matches(std::span<const unsigned char> page, std::uint64_t number);

// Makes the page match if one bit of it, or of its checksum, has flipped; false, and the page as it was, otherwise. That a page comes to match by chance
// is as likely as 32,768 in 2^64. Some 10 ms a page of 4 KiB.
bool mend_page(std::span<unsigned char> page, std::uint64_t number);

// Puts into the first page what the header of every catalogue of ours has that is `pages` long, whatever else is in it
// (https://www.sqlite.org/fileformat.html, section 1.3).
void put_known_header(std::span<unsigned char> page, std::size_t pages);

}  // namespace lightstage::db
