// The trained network that comes with the program.
#pragma once

#include <filesystem>

namespace lightstage::model {

// The checkpoint of `blend`: beside an installed program in ../share/lightstage, else in the source tree it was built from. Empty when neither is
// there.
std::filesystem::path shipped_blend();

}  // namespace lightstage::model
