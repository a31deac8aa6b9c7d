// The least squares behind calibrate_cameras: which lenses and poses explain the corners seen best, and how certain they are.
#pragma once

#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "calib/board.h"
#include "calib/board/lens_cost.h"
#include "calib/camera_calibration.h"

namespace ceres {
class Problem;
}

namespace lightstage::calib {

// The problem in the making: lenses and poses of those cameras and instants that are in it. Views may come and go between calls.
class CameraBundle {
 public:
  struct View {
    std::size_t given = 0;  // into the views handed over
    std::size_t camera = 0, instant = 0;
    std::vector<BoardCorner> corners;
  };

  CameraBundle(const Board& board, DistortionTerms terms, std::size_t cameras, std::size_t instants);

  enum class Loss { kNone, kHuber, kCauchy };

  std::vector<View> views;
  std::vector<Lens> lenses;
  std::vector<core::RigidTransform> rig_from_camera, rig_from_board;  // by camera, by instant
  std::vector<double> sigma_px;                                       // of a coordinate, by camera
  double focal_from = 1, focal_to = 1e7;

  // Returns the cost reached. The first camera stays where it is.
  double minimise(Loss loss, int most_iterations = 100);

  // Where the corner should be seen; nothing behind the camera.
  std::optional<core::Pixel> predicted(const View& view, const BoardCorner& corner) const;

  // From there to where it was seen.
  double distance_px(const View& view, const BoardCorner& corner) const;

  // From the median distance of each camera's corners, which few wrong ones do not move (Rayleigh's is 1.1774 standard errors).
  void estimate_sigmas_by_median();

  // From the sums of squares, with what the parameters took up shared out by the number of corners.
  void estimate_sigmas();

  // Standard errors of lens and pose by camera, by inversion of the normal equations with their columns scaled to one. Names what is not
  // determined: (camera, parameter).
  struct Errors {
    std::vector<CameraErrors> sigma;
    std::vector<core::Mat3> position_covariance;
    std::vector<std::pair<std::size_t, std::string>> undetermined;
  };
  Errors errors();

  core::CameraModel model(std::size_t camera, const RigCamera& size) const;

  std::vector<std::size_t> used_instants() const;
  std::size_t instants_used() const { return used_instants().size(); }

 private:
  // Corrections to the poses, which live as long as the problem.
  struct Steps {
    explicit Steps(const CameraBundle& bundle) : cameras(bundle.lenses.size()), boards(bundle.rig_from_board.size()) {}
    std::vector<Step> cameras, boards;
  };

  void build(ceres::Problem& problem, Steps& steps, Loss kind);

  Board board_;
  std::vector<int> fixed_;
};

}  // namespace lightstage::calib
