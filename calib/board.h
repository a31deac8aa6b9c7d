// Flat calibration boards: what is printed, and where its corners are in a picture.
#pragma once

#include <string>
#include <vector>

#include "core/camera_model.h"
#include "core/image.h"
#include "core/vec3.h"

namespace lightstage::calib {

enum class BoardKind {
  kChessboard,
  kCharuco,  // a chessboard with an ArUco marker in every white square: parts of it suffice, and it is never taken for itself turned
  // or mirrored (Garrido-Jurado et al. 2014, "Automatic generation and detection of highly reliable fiducial markers")
};

// `columns` x `rows` squares; the top left one is black. Board frame: metres, origin at the top left corner of the squares' field, x
// right, y down, z away from who looks at its front.
struct Board {
  BoardKind kind = BoardKind::kCharuco;
  int columns = 9, rows = 7;
  double square_m = 0.025;
  double marker_m = 0.0175;  // side of a ChArUco board's markers
  std::string dictionary =
      "4x4_250";  // of its markers: 4x4, 5x5, 6x6 or 7x7 and _50, _100, _250 or _1000, or aruco_original

  // Inner corners, where four squares meet: counted row by row from the top left one.
  int corner_count() const { return (columns - 1) * (rows - 1); }
  core::Vec3 corner(int id) const {
    return {square_m * (id % (columns - 1) + 1), square_m * (id / (columns - 1) + 1), 0};
  }
  // Turned by half a turn it looks the same: which end is up is then known only from other cameras.
  bool looks_same_upside_down() const { return kind == BoardKind::kChessboard && (columns + rows) % 2 == 0; }
};

// Throws BadInput for a board that cannot be found or measured with: fewer than 3 x 3 or more than 100 x 100 squares, a chessboard of as
// many columns as rows (which looks the same when turned by a quarter), sizes that are not positive, markers that are not smaller than the
// squares, a dictionary that is not known or has too few markers.
void require_usable(const Board& board);

// The board as it is printed: one channel, 0 where black and 1 where white, `pixels_per_square` pixels a square, with a white
// margin of `margin_px` pixels all round. Throws as require_usable, and for markers of fewer pixels than they have bits.
core::Image board_picture(const Board& board, int pixels_per_square, int margin_px);

struct BoardCorner {
  int id = 0;
  core::Pixel position;
};

// How a chessboard's corners are found, and refined where they lie to fractions of a pixel.
enum class CornerMethod {
  kClassic,  // OpenCV's findChessboardCorners, then cornerSubPix: edges run at right angles to the way from their corner
  kSectors,  // findChessboardCornersSB alone (Duda and Frese 2018, "Accurate detection and localization of checkerboard corners")
  kEither,  // found by the first or, failing that, the second in a picture of at most 1600 pixels; cornerSubPix in the full one
};

struct BoardSeen {
  std::vector<BoardCorner> corners;  // by id; empty where there is no board
  std::string reason;                // why there are none, and what to do
};

// The board's corners in a linear picture, sub-pixel. A chessboard is found as a whole or not at all, a ChArUco board in parts of at least
// 6 corners that do not lie in a line. Corners run clockwise about the board as in the board frame, so that no pose is mirrored; the
// colours of the squares tell which end is up, save where it looks the same upside down. Pictures that show a ChArUco board
// mirrored are refused with the reason; a mirrored chessboard looks like a chessboard. `method` is for chessboards; the corners of
// ChArUco boards are refined by cornerSubPix, in windows that the markers do not reach into. Throws as require_usable.
BoardSeen find_board(core::ImageView picture, const Board& board, CornerMethod method = CornerMethod::kEither);

}  // namespace lightstage::calib
