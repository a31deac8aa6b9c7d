// Small fixed-size geometry in float64. Frames and units are the caller's and named where they matter; the
// stage frame is right-handed, in metres, x right, y up, z from the subject towards the primary camera,
// origin at stage centre.
#pragma once

#include <array>
#include <cmath>

namespace lightstage::core {

struct Vec3 {
  double x = 0, y = 0, z = 0;

  friend Vec3 operator+(Vec3 a, Vec3 b) { return {a.x + b.x, a.y + b.y, a.z + b.z}; }
  friend Vec3 operator-(Vec3 a, Vec3 b) { return {a.x - b.x, a.y - b.y, a.z - b.z}; }
  friend Vec3 operator-(Vec3 a) { return {-a.x, -a.y, -a.z}; }
  friend Vec3 operator*(Vec3 a, double s) { return {a.x * s, a.y * s, a.z * s}; }
  friend Vec3 operator*(double s, Vec3 a) { return a * s; }
  friend Vec3 operator/(Vec3 a, double s) { return {a.x / s, a.y / s, a.z / s}; }
  friend bool operator==(const Vec3&, const Vec3&) = default;
};

inline double dot(Vec3 a, Vec3 b) {
  return a.x * b.x + a.y * b.y + a.z * b.z;
}
inline Vec3 cross(Vec3 a, Vec3 b) {
  return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}
// Neither overflows nor underflows for any finite vector.
inline double norm(Vec3 a) {
  return std::hypot(a.x, a.y, a.z);
}

// Row-major 3x3 matrix; for rotations the rows are the target frame's axes written in the source frame.
struct Mat3 {
  std::array<Vec3, 3> rows{Vec3{1, 0, 0}, Vec3{0, 1, 0}, Vec3{0, 0, 1}};

  friend Vec3 operator*(const Mat3& m, Vec3 v) { return {dot(m.rows[0], v), dot(m.rows[1], v), dot(m.rows[2], v)}; }
  Mat3 transposed() const {
    return {{Vec3{rows[0].x, rows[1].x, rows[2].x}, Vec3{rows[0].y, rows[1].y, rows[2].y},
             Vec3{rows[0].z, rows[1].z, rows[2].z}}};
  }
  friend Mat3 operator*(const Mat3& a, const Mat3& b) {
    const Mat3 t = b.transposed();
    Mat3 result;
    for (std::size_t r = 0; r < 3; ++r) result.rows[r] = t * a.rows[r];
    return result;
  }
};

// Rotation by an angle about an axis (Rodrigues' formula); the axis need not be of unit length but must not
// be zero.
Mat3 rotation_about(Vec3 axis, double angle_radians);

// target = rotation * source + translation. Named target_from_source, as in stage_from_camera.
struct RigidTransform {
  Mat3 rotation;
  Vec3 translation;

  Vec3 apply(Vec3 point) const { return rotation * point + translation; }
  RigidTransform inverse() const {
    const Mat3 back = rotation.transposed();
    return {back, -(back * translation)};
  }
};

}  // namespace lightstage::core
