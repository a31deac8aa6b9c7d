// A matt white card, facing +z.
#pragma once

#include <memory>

#include "sim/render/subject.h"

namespace lightstage::sim {

// A square of `height` metres about the stage's centre.
std::unique_ptr<Subject> make_white_card(double height);

}  // namespace lightstage::sim
