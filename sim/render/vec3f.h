// Small float32 geometry for rendering; core::Vec3 is the float64 one.
#pragma once

#include <cmath>

#include "core/vec3.h"

namespace lightstage::sim {

struct Vec3f {
  float x = 0, y = 0, z = 0;

  constexpr Vec3f() = default;
  constexpr Vec3f(float x_, float y_, float z_) : x(x_), y(y_), z(z_) {}
  explicit Vec3f(core::Vec3 v) : x(float(v.x)), y(float(v.y)), z(float(v.z)) {}

  friend constexpr Vec3f operator+(Vec3f a, Vec3f b) { return {a.x + b.x, a.y + b.y, a.z + b.z}; }
  friend constexpr Vec3f operator-(Vec3f a, Vec3f b) { return {a.x - b.x, a.y - b.y, a.z - b.z}; }
  friend constexpr Vec3f operator-(Vec3f a) { return {-a.x, -a.y, -a.z}; }
  friend constexpr Vec3f operator*(Vec3f a, float s) { return {a.x * s, a.y * s, a.z * s}; }
  friend constexpr Vec3f operator*(float s, Vec3f a) { return a * s; }
  friend constexpr Vec3f operator*(Vec3f a, Vec3f b) { return {a.x * b.x, a.y * b.y, a.z * b.z}; }
  friend bool operator==(const Vec3f&, const Vec3f&) = default;
};

inline core::Vec3 to_double(Vec3f v) {
  return {double(v.x), double(v.y), double(v.z)};
}
inline float dot(Vec3f a, Vec3f b) {
  return a.x * b.x + a.y * b.y + a.z * b.z;
}
inline Vec3f cross(Vec3f a, Vec3f b) {
  return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}
inline float norm(Vec3f a) {
  return std::sqrt(dot(a, a));
}
// The zero vector stays zero.
inline Vec3f normalised(Vec3f a) {
  const float length = norm(a);
  return length > 0 ? a * (1 / length) : a;
}
inline Vec3f lerp(Vec3f a, Vec3f b, float t) {
  return a + (b - a) * t;
}

}  // namespace lightstage::sim
