#include "core/vec3.h"

#include "core/direction.h"

namespace lightstage::core {

// R = I + sin(a) K + (1 - cos(a)) K^2, K the cross-product matrix of the unit axis.
Mat3 rotation_about(Vec3 axis, double angle_radians) {
  const Vec3 k = Direction::from_vector(axis).vec();
  const double sine = std::sin(angle_radians);
  // 1 - cos(a) without cancellation at small angles.
  const double half_sine = std::sin(angle_radians / 2);
  const double versine = 2 * half_sine * half_sine;
  const auto rotate = [&](Vec3 v) {
    const Vec3 kv = cross(k, v);
    return v + sine * kv + versine * cross(k, kv);
  };
  return Mat3{{rotate({1, 0, 0}), rotate({0, 1, 0}), rotate({0, 0, 1})}}.transposed();
}

}  // namespace lightstage::core
