// Random numbers that are a function of a key and a counter: the same on any number of threads and in any
// order.
#pragma once

#include <cmath>
#include <cstdint>
#include <initializer_list>
#include <numbers>
#include <utility>

namespace lightstage::sim {

// The n-th output of the splitmix64 generator started at `key` (Steele, Lea, Flood 2014, "Fast splittable
// pseudorandom number generators").
inline std::uint64_t random_bits(std::uint64_t key, std::uint64_t n) {
  std::uint64_t z = key + (n + 1) * 0x9e3779b97f4a7c15u;
  z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9u;
  z = (z ^ (z >> 27)) * 0x94d049bb133111ebu;
  return z ^ (z >> 31);
}

// One key from several words, such as a seed, a camera and a time; their order counts.
inline std::uint64_t random_key(std::initializer_list<std::uint64_t> words) {
  std::uint64_t key = 0;
  for (const std::uint64_t word : words) key = random_bits(key ^ word, 0);
  return key;
}

// Uniform in (0, 1), both ends excluded.
inline double uniform(std::uint64_t bits) {
  return (static_cast<double>(bits >> 11) + 0.5) * 0x1p-53;
}

// Two independent standard normal numbers (Box and Muller 1958).
inline std::pair<double, double> normal_pair(std::uint64_t bits0, std::uint64_t bits1) {
  const double radius = std::sqrt(-2 * std::log(uniform(bits0)));
  const double angle = 2 * std::numbers::pi * uniform(bits1);
  return {radius * std::cos(angle), radius * std::sin(angle)};
}

}  // namespace lightstage::sim
