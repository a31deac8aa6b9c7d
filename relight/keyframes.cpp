#include "relight/keyframes.h"

#include <cmath>

#include "core/error.h"

namespace lightstage::relight {

double between(double from, double to, double share) {
  return share == 1 ? to : from + share * (to - from);
}

core::Vec3 between(core::Vec3 from, core::Vec3 to, double share) {
  return {between(from.x, to.x, share), between(from.y, to.y, share), between(from.z, to.z, share)};
}

core::Direction between(const core::Direction& from, const core::Direction& to, double share) {
  if (share == 0 || from == to) return from;
  if (share == 1) return to;
  if (are_opposite(from, to)) throw core::UsageError("there is no shorter way between opposite directions");
  // The usual weights over sin(angle), of which from_vector frees the sum; both vanish together at small angles, where
  // the weights are the shares themselves.
  const double angle = core::angle_radians(from, to);
  const bool is_small = angle < 1e-8;
  const double before = is_small ? 1 - share : std::sin((1 - share) * angle);
  const double after = is_small ? share : std::sin(share * angle);
  return core::Direction::from_vector(before * from.vec() + after * to.vec());
}

bool are_opposite(const core::Direction& a, const core::Direction& b) {
  return core::norm(a.vec() + b.vec()) < 1e-6;
}

}  // namespace lightstage::relight
