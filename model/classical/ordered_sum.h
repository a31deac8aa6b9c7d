// Sums over many things on many threads that come out the same for any number of them.
#pragma once

#include <cstddef>
#include <utility>
#include <vector>

#include "core/parallel.h"
#include "core/vec3.h"

namespace lightstage::model {

// `length` colours, to which add(first, last, colours) has added the share of every q in [0, count), a part of them at a time. The parts depend on
// `count` alone; each is summed by one thread, and then the parts in order.
template <class AddPart>
std::vector<core::Vec3> ordered_sum_of_parts(std::size_t count, std::size_t length, const AddPart& add) {
  constexpr std::size_t kParts = 64;
  const std::size_t part = count / kParts + 1;
  std::vector<std::vector<core::Vec3>> parts(count / part + 1);
  core::parallel_for(count, part, [&](std::size_t first, std::size_t last) {
    std::vector<core::Vec3> colours(length);
    add(first, last, colours);
    parts[first / part] = std::move(colours);
  });
  std::vector<core::Vec3> total(length);
  for (const std::vector<core::Vec3>& colours : parts)
    for (std::size_t i = 0; i < colours.size(); ++i) total[i] = total[i] + colours[i];
  return total;
}

// The same with add(q, colours) for every q, in order.
template <class Add>
std::vector<core::Vec3> ordered_sum(std::size_t count, std::size_t length, const Add& add) {
  return ordered_sum_of_parts(count, length,
                              [&](std::size_t first, std::size_t last, std::vector<core::Vec3>& colours) {
                                for (std::size_t q = first; q < last; ++q) add(q, colours);
                              });
}

}  // namespace lightstage::model
