#include <Eigen/Dense>
#include <cmath>

#include "calib/board/start.h"
#include "calib/camera_calibration.h"
#include "core/direction.h"
#include "core/error.h"

namespace lightstage::calib {

namespace {

using core::Vec3;

Eigen::Vector3d eigen(Vec3 v) {
  return {v.x, v.y, v.z};
}

// Centre and the ends of the three axes.
std::array<Vec3, 4> frame_points(const core::RigidTransform& t, double length) {
  return {t.translation, t.apply({length, 0, 0}), t.apply({0, length, 0}), t.apply({0, 0, length})};
}

}  // namespace

RigPlacement place_rig(CameraCalibration& calibration, const std::vector<core::CameraModel>& drawn) {
  const std::size_t n = calibration.cameras.size();
  if (drawn.size() != n || n == 0)
    throw core::BadInput("placing a rig: as many cameras must be drawn as were calibrated");
  double length = 0;
  for (const core::CameraModel& camera : drawn) length += norm(camera.centre()) / double(n);
  if (!(length > 0)) length = 1;

  Eigen::Matrix3Xd from(3, 4 * n), to(3, 4 * n);
  double found_spread = 0, drawn_spread = 0;
  for (std::size_t c = 0; c < n; ++c) {
    const auto found_points = frame_points(calibration.cameras[c].model.stage_from_camera, length);
    const auto drawn_points = frame_points(drawn[c].stage_from_camera, length);
    for (std::size_t p = 0; p < 4; ++p) {
      from.col(Eigen::Index(4 * c + p)) = eigen(found_points[p]);
      to.col(Eigen::Index(4 * c + p)) = eigen(drawn_points[p]);
    }
    for (std::size_t other = 0; other < c; ++other) {
      found_spread += norm(calibration.cameras[c].model.centre() - calibration.cameras[other].model.centre());
      drawn_spread += norm(drawn[c].centre() - drawn[other].centre());
    }
  }
  const Eigen::Matrix4d moved = Eigen::umeyama(from, to, false);
  core::RigidTransform stage_from_rig;
  for (int r = 0; r < 3; ++r) stage_from_rig.rotation.rows[std::size_t(r)] = {moved(r, 0), moved(r, 1), moved(r, 2)};
  stage_from_rig.translation = {moved(0, 3), moved(1, 3), moved(2, 3)};

  RigPlacement placement;
  if (found_spread > 0) placement.drawn_over_found = drawn_spread / found_spread;
  for (std::size_t c = 0; c < n; ++c) {
    CalibratedCamera& camera = calibration.cameras[c];
    core::RigidTransform& pose = camera.model.stage_from_camera;
    pose = stage_from_rig * pose;
    const core::Mat3& r = stage_from_rig.rotation;
    core::Mat3& covariance = camera.position_covariance;
    covariance = r * covariance * r.transposed();
    camera.sigma.position = {std::sqrt(covariance.rows[0].x), std::sqrt(covariance.rows[1].y),
                             std::sqrt(covariance.rows[2].z)};
    const double off = norm(pose.translation - drawn[c].centre());
    const double turn = distance_between({pose.rotation, {}}, {drawn[c].stage_from_camera.rotation, {}}, 1);
    placement.position_rms_m += off * off / double(n);
    placement.rotation_rms_degrees += std::pow(core::degrees_from_radians(turn), 2) / double(n);
  }
  placement.position_rms_m = std::sqrt(placement.position_rms_m);
  placement.rotation_rms_degrees = std::sqrt(placement.rotation_rms_degrees);
  for (auto& board : calibration.rig_from_board) {
    if (board) board = stage_from_rig * *board;
  }
  return placement;
}

}  // namespace lightstage::calib
