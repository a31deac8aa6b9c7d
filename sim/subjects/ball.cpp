#include "sim/subjects/ball.h"

#include <algorithm>

namespace lightstage::sim {

std::optional<SurfaceSample> Ball::sample(core::Vec3 origin, core::Vec3 unit_direction) const {
  // The ray's point nearest the centre, and from its distance half the chord: no difference of large squares.
  const double along = -core::dot(origin, unit_direction);
  const core::Vec3 nearest = origin + unit_direction * along;
  const double miss = core::norm(nearest);
  if (along <= 0 || miss >= radius_) return std::nullopt;
  const double half_chord = std::sqrt((radius_ - miss) * (radius_ + miss));
  const core::Vec3 position = nearest - unit_direction * half_chord;
  SurfaceSample sample;
  sample.position = Vec3f(position);
  sample.normal = Vec3f(position / radius_);
  sample.shadow_origin = sample.position;
  sample.to_viewer = -Vec3f(unit_direction);
  sample.albedo = Vec3f(float(albedo_), float(albedo_), float(albedo_));
  return sample;
}

void Ball::visibility(const SurfaceSample&, std::span<const int>, std::span<float> out) const {
  std::fill(out.begin(), out.end(), 1.0F);
}

}  // namespace lightstage::sim
