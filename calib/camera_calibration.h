// Lenses and poses of one or several cameras from pictures of a board, by bundle adjustment.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "calib/board.h"
#include "core/camera_model.h"
#include "core/vec3.h"

namespace lightstage::calib {

// Which of the lens's distortion terms (core/camera_model.h) are estimated; the others are 0.
enum class DistortionTerms { kNone, kK1, kK1K2, kK1K2P1P2, kAll };

struct RigCamera {
  std::string name;
  int width = 0, height = 0;  // pixels
};

// One camera's picture of the board at one instant: pictures of one instant show the board in one pose.
struct BoardView {
  std::size_t camera = 0, instant = 0;
  std::vector<BoardCorner> corners;
};

struct CameraCalibrationInput {
  Board board;  // flat, and of the size given: its size is the rig's scale
  std::vector<RigCamera> cameras;
  std::vector<BoardView> views;  // at most one for each camera and instant; those without corners may be left out
  DistortionTerms distortion = DistortionTerms::kK1K2P1P2;
};

// One standard error of each parameter, 0 for what is not estimated.
struct CameraErrors {
  double fx = 0, fy = 0, cx = 0, cy = 0;
  double k1 = 0, k2 = 0, k3 = 0, p1 = 0, p2 = 0;
  core::Vec3 position;  // metres, along the axes of the frame in which the pose is given
  core::Vec3 rotation;  // radians, about the camera's own axes
};

struct CalibratedCamera {
  RigCamera camera;
  core::CameraModel model;  // stage_from_camera is rig_from_camera until place_rig
  CameraErrors sigma;       // the pose's against the first camera's
  core::Mat3 position_covariance{{core::Vec3{}, core::Vec3{}, core::Vec3{}}};  // square metres
  double sigma_px = 0;  // of a corner's coordinate, as the residuals show
  std::size_t views = 0, corners = 0;
  double reach = 0;         // how far from the principal point corners were seen, 1 at the picture's farthest corner
  double tilt_degrees = 0;  // largest angle between two of the board's poses
  std::vector<std::string> warnings;  // what the pictures leave uncertain, and what to do
};

struct CalibratedView {
  std::size_t camera = 0, instant = 0;
  bool used = false;
  std::string reason;                  // why not, or how many corners were left out
  double rms_px = 0;                   // distance of the corners from where the calibration puts them, root mean square
  std::vector<BoardCorner> corners;    // that were used
  std::vector<core::Pixel> predicted;  // of each of them
};

struct CameraCalibration {
  std::vector<CalibratedCamera> cameras;                            // as given
  std::vector<CalibratedView> views;                                // as given
  std::vector<std::optional<core::RigidTransform>> rig_from_board;  // by instant
  double rms_px = 0;                                                // over all corners used, distance
};

// Intrinsics, distortion and poses of all cameras and the poses of the board at every instant, together: least squares of the distances
// between corners seen and predicted, each over its camera's standard error (Ceres Solver; Triggs et al. 2000, "Bundle adjustment - a modern
// synthesis"). Focal lengths start from the homographies (Zhang 2000, "A flexible new technique for camera calibration", with the principal
// point in the middle), board poses from IPPE (Collins and Bartoli 2014), of whose two answers the better is taken. First with a Cauchy
// loss; views whose corners are far off (four times the usual, and 0.5 px) and corners more than six standard errors off are left out, and the rest is solved without. The frame is that of the
// first camera. Which end of a chessboard that looks the same upside down is up, is found from the cameras' poses, which do not change.
// Standard errors from the inverse of the normal equations, scaled by what the residuals show of each camera.
// Throws BadInput naming the camera and saying what to do: fewer than 3 views of a camera, all its views parallel (within 5 degrees), a
// camera that never sees the board together with the others, parameters that the pictures do not determine at all, or so badly
// that the focal length is not certain to 5 %. 24 views of 88 corners by 3 cameras take about 3 s.
CameraCalibration calibrate_cameras(const CameraCalibrationInput& input);

// Moves the rig by the rigid transform that brings its cameras to the drawn ones (same order) as nearly as it can: least squares of the
// cameras' centres and of points one typical distance out along their axes (Kabsch 1976), so that one camera suffices. Board poses move too,
// and the positions' covariances turn with it. Returns root mean squares over the cameras of what is left, and how much longer drawn
// distances between cameras are than found (1 for a single camera): far from 1 where the board's size is given wrong.
struct RigPlacement {
  double position_rms_m = 0, rotation_rms_degrees = 0;
  double drawn_over_found = 1;
};
RigPlacement place_rig(CameraCalibration& calibration, const std::vector<core::CameraModel>& drawn);

}  // namespace lightstage::calib
