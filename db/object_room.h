// How much of a disk pictures take in a store, before they are there.
#pragma once

#include <cstddef>
#include <cstdint>

#include "core/image.h"

namespace lightstage::db {

// The most that `count` images of this size take, objects and rows: half floats, not compressed.
std::uintmax_t most_bytes(core::ImageSize size, std::size_t count = 1);

}  // namespace lightstage::db
