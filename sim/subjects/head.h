// A procedural head: another person for every seed.
#pragma once

#include <cstdint>
#include <memory>

#include "sim/render/subject.h"

namespace lightstage::sim {

// `height` in metres, from the cut of the neck to the top of the hair. Proportions, skin, hair, eyes and
// gloss follow from the seed.
std::unique_ptr<Subject> make_head(std::uint64_t seed, double height);

}  // namespace lightstage::sim
