// Calibration of two cameras from rendered views of a board: what more views, other corner finders and other distortion terms gain and cost.
#pragma once

#include <string>
#include <vector>

namespace lightstage::cli {

struct BoardBenchRow {
  int views = 0;              // instants at which both cameras took a picture
  std::string corners;        // "classic", "sectors", "either" (chessboard) or "charuco"
  std::string distortion;     // terms estimated: "none", "k1", "k1,k2", "k1,k2,p1,p2" or "k1,k2,k3,p1,p2"
  double seconds = 0;         // finding the corners and bundle adjustment
  double undistorted_px = 0;  // root mean square over the picture's pixels by which undistortion misplaces them
  double focal_percent = 0;   // the larger of both axes and cameras, as the next
  double principal_px = 0;
  double position_mm = 0, rotation_degrees = 0;  // of the second camera against the first
  std::string refused;                           // why there is no result; the errors are then NaN
};

// 640 x 480 pixels, barrel and tangential distortion, sensor noise at 12 bits; the default of each knob where another one is turned. The
// truth is asked only afterwards. About half a minute of one core.
std::vector<BoardBenchRow> bench_boards();

}  // namespace lightstage::cli
