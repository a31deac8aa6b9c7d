// Random numbers by counter: the n-th number of a seed does not depend on how many were asked for before, and
// is the same on every machine.
#pragma once

#include <cmath>
#include <cstdint>
#include <numbers>

namespace lightstage::sim {

// The finaliser of SplitMix64 (Steele, Lea, Flood 2014, "Fast splittable pseudorandom number generators").
inline std::uint64_t mix(std::uint64_t x) {
  x += 0x9e3779b97f4a7c15u;
  x = (x ^ (x >> 30)) * 0xbf58476d1ce4e5b9u;
  x = (x ^ (x >> 27)) * 0x94d049bb133111ebu;
  return x ^ (x >> 31);
}

inline std::uint64_t mix(std::uint64_t seed, std::uint64_t counter) {
  return mix(mix(seed) ^ counter);
}

// Uniform in (0, 1).
inline double uniform(std::uint64_t seed, std::uint64_t counter) {
  return (double(mix(seed, counter) >> 11) + 0.5) * 0x1p-53;
}

// Normal with mean 0 and standard deviation 1 (Box and Muller).
inline double normal(std::uint64_t seed, std::uint64_t counter) {
  const double radius = std::sqrt(-2 * std::log(uniform(seed, 2 * counter)));
  return radius * std::cos(2 * std::numbers::pi * uniform(seed, 2 * counter + 1));
}

}  // namespace lightstage::sim
