// Skin, lips, brows, hair and eyes of the procedural head.
#pragma once

#include <memory>

#include "sim/subjects/head_shape.h"

namespace lightstage::sim {

// Where the shape lies in the subject frame: p = offset + scale * shape, metres a centimetre.
struct HeadPlacement {
  Vec3f offset;
  float scale = 1;
};

std::unique_ptr<const Appearance> make_head_skin(const HeadShape& shape, HeadPlacement placement, std::uint64_t seed);

}  // namespace lightstage::sim
