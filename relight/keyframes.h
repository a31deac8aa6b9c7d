// Values that change with time, from keyframes.
#pragma once

#include <vector>

#include "core/direction.h"
#include "core/vec3.h"

namespace lightstage::relight {

// What lies `share` of the way from `from` to `to`, share in [0, 1]; exactly the ends at 0 and 1.
double between(double from, double to, double share);
core::Vec3 between(core::Vec3 from, core::Vec3 to, double share);
// Along the great circle, the shorter way, at constant speed (Shoemake 1985, "Animating rotation with quaternion curves":
// slerp). Throws UsageError for opposite directions, between which there is no one shorter way.
core::Direction between(const core::Direction& from, const core::Direction& to, double share);

// Opposite to within a millionth of a radian.
bool are_opposite(const core::Direction& a, const core::Direction& b);

template <class Value>
struct Keyframe {
  double seconds = 0;
  Value value{};
};

// A value over time: a constant, or keyframes with what lies between them. Before the first and after the last
// keyframe theirs holds.
template <class Value>
class Track {
 public:
  Track(Value constant) : keys_{{0, constant}} {}
  // At least one, in order of time, no two at one time.
  explicit Track(std::vector<Keyframe<Value>> keys) : keys_(std::move(keys)) {}

  bool is_fixed() const {
    for (const Keyframe<Value>& key : keys_)
      if (!(key.value == keys_.front().value)) return false;
    return true;
  }

  Value at(double seconds) const {
    std::size_t next = 0;
    while (next < keys_.size() && keys_[next].seconds <= seconds) ++next;
    if (next == 0) return keys_.front().value;
    const Keyframe<Value>& from = keys_[next - 1];
    if (next == keys_.size()) return from.value;
    const Keyframe<Value>& to = keys_[next];
    return between(from.value, to.value, (seconds - from.seconds) / (to.seconds - from.seconds));
  }

 private:
  std::vector<Keyframe<Value>> keys_;
};

}  // namespace lightstage::relight
