// Calibration boards as TOML files, which `calibrate board` writes and `calibrate cameras` reads.
#pragma once

#include <filesystem>
#include <string>

#include "calib/board.h"

namespace lightstage::cli {

// kind = "charuco" or "chessboard", columns, rows, square_mm, and for ChArUco marker_mm and dictionary. Throws BadInput with file and line.
calib::Board read_board(const std::filesystem::path& path);
std::string to_toml(const calib::Board& board);

}  // namespace lightstage::cli
