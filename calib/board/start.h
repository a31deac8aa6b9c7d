// Where bundle adjustment of cameras starts: focal lengths, poses of the board, poses of the cameras to each other.
#pragma once

#include <optional>
#include <vector>

#include "calib/camera_calibration.h"

namespace lightstage::calib {

// The focal length that makes the board's axes perpendicular and equally long in every view, with the principal point in the picture's middle
// and without distortion (Zhang 2000, eqs. 3 and 4, least squares over the views). Nothing where the views say nothing of it.
std::optional<double> focal_from_homographies(const Board& board, const RigCamera& camera,
                                              const std::vector<const BoardView*>& views);

// camera_from_board of the view for a lens that is known (the model's pose is not looked at); nothing where no pose has the board in front
// of the camera.
std::optional<core::RigidTransform> board_pose(const Board& board, const core::CameraModel& lens,
                                               const std::vector<BoardCorner>& corners);

// board_from_board of half a turn about its middle.
core::RigidTransform half_turn(const Board& board);
// What the corners are called when the other end of the board is up.
void turn_upside_down(const Board& board, std::vector<BoardCorner>& corners);

// A rotation's angle and a translation as one number: radians, with lengths over `length_m`.
double distance_between(const core::RigidTransform& a, const core::RigidTransform& b, double length_m);

core::RigidTransform operator*(const core::RigidTransform& outer, const core::RigidTransform& inner);

// The pose of one camera in another's frame that most instants agree with. `first` and `second` are camera_from_board at the same instants;
// with `ambiguous_turn` each pair may differ by half a turn of the board.
struct RelativePose {
  core::RigidTransform first_from_second;
  bool certain = true;  // false: with the other end up everything fits as well
};
RelativePose relative_pose(const std::vector<core::RigidTransform>& first,
                           const std::vector<core::RigidTransform>& second,
                           const std::optional<core::RigidTransform>& ambiguous_turn);

}  // namespace lightstage::calib
