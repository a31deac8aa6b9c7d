// Where a corner of the board is seen, with derivatives: the projection of core::CameraModel for automatic differentiation.
#pragma once

#include <ceres/rotation.h>

#include <array>

#include "core/camera_model.h"
#include "core/vec3.h"

namespace lightstage::calib {

// fx, fy, cx, cy, k1, k2, k3, p1, p2.
using Lens = std::array<double, 9>;
// A small motion on top of a pose: rotation about the axes of the frame that moves (radians), then metres along those of the frame it is
// in. Zero is the pose itself, so angles never grow and standard errors are what they seem.
using Step = std::array<double, 6>;

template <class T>
using Point = std::array<T, 3>;

// rotation * exp(-step): from the outer frame into the inner one.
template <class T>
Point<T> into_frame(const core::RigidTransform& outer_from_inner, const T* step, const Point<T>& p) {
  const core::Vec3 t = outer_from_inner.translation;
  const Point<T> d{p[0] - t.x - step[3], p[1] - t.y - step[4], p[2] - t.z - step[5]};
  const core::Mat3 back = outer_from_inner.rotation.transposed();
  Point<T> turned;
  for (std::size_t r = 0; r < 3; ++r) turned[r] = back.rows[r].x * d[0] + back.rows[r].y * d[1] + back.rows[r].z * d[2];
  const Point<T> turn{-step[0], -step[1], -step[2]};
  Point<T> result;
  ceres::AngleAxisRotatePoint(turn.data(), turned.data(), result.data());
  return result;
}

template <class T>
Point<T> out_of_frame(const core::RigidTransform& outer_from_inner, const T* step, core::Vec3 p) {
  const Point<T> inner{T(p.x), T(p.y), T(p.z)};
  Point<T> turned;
  ceres::AngleAxisRotatePoint(step, inner.data(), turned.data());
  const core::Mat3& m = outer_from_inner.rotation;
  const core::Vec3 t = outer_from_inner.translation;
  return {m.rows[0].x * turned[0] + m.rows[0].y * turned[1] + m.rows[0].z * turned[2] + t.x + step[3],
          m.rows[1].x * turned[0] + m.rows[1].y * turned[1] + m.rows[1].z * turned[2] + t.y + step[4],
          m.rows[2].x * turned[0] + m.rows[2].y * turned[1] + m.rows[2].z * turned[2] + t.z + step[5]};
}

// False for a point behind the camera.
template <class T>
bool project(const T* lens, const Point<T>& p, T* pixel) {
  if (!(p[2] > T(1e-9))) return false;
  const T x = p[0] / p[2], y = p[1] / p[2];
  const T r2 = x * x + y * y;
  const T radial = T(1) + r2 * (lens[4] + r2 * (lens[5] + r2 * lens[6]));
  pixel[0] = lens[0] * (x * radial + T(2) * lens[7] * x * y + lens[8] * (r2 + T(2) * x * x)) + lens[2];
  pixel[1] = lens[1] * (y * radial + T(2) * lens[8] * x * y + lens[7] * (r2 + T(2) * y * y)) + lens[3];
  return true;
}

// A corner's distance from where it should be, over its standard error.
struct CornerCost {
  const core::RigidTransform* rig_from_camera;
  const core::RigidTransform* rig_from_board;
  core::Vec3 corner;  // board frame
  core::Pixel seen;
  double sigma_px;

  template <class T>
  bool operator()(const T* lens, const T* camera, const T* board, T* residuals) const {
    T pixel[2];
    if (!project(lens, into_frame(*rig_from_camera, camera, out_of_frame(*rig_from_board, board, corner)), pixel)) {
      return false;
    }
    residuals[0] = (pixel[0] - seen.x) / sigma_px;
    residuals[1] = (pixel[1] - seen.y) / sigma_px;
    return true;
  }
};

// The pose after the step.
inline core::RigidTransform stepped(const core::RigidTransform& pose, const Step& step) {
  core::RigidTransform result = pose;
  const core::Vec3 turn{step[0], step[1], step[2]};
  if (norm(turn) > 0) result.rotation = pose.rotation * core::rotation_about(turn, norm(turn));
  result.translation = pose.translation + core::Vec3{step[3], step[4], step[5]};
  return result;
}

}  // namespace lightstage::calib
