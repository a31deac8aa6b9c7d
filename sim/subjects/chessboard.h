// A flat chessboard, facing +z.
#pragma once

#include <memory>

#include "sim/render/subject.h"

namespace lightstage::sim {

constexpr int kChessboardColumns = 9, kChessboardRows = 7;  // squares: 8 x 6 inner corners

// `height` is that of the squares' field in metres; a white margin one square wide surrounds it.
std::unique_ptr<Subject> make_chessboard(double height);

}  // namespace lightstage::sim
