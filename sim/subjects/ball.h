// A Lambertian ball, exact: no triangles.
#pragma once

#include "sim/render/subject.h"

namespace lightstage::sim {

class Ball : public Subject {
 public:
  // Centred on the origin; grey of the given albedo.
  Ball(double radius, double albedo) : radius_(radius), albedo_(albedo) {}

  std::optional<SurfaceSample> sample(core::Vec3 origin, core::Vec3 unit_direction) const override;
  // A convex body shadows only what faces away from the light.
  bool shadowed(const SurfaceSample&, Vec3f) const override { return false; }
  void visibility(const SurfaceSample& sample, std::span<const int> light_indices, std::span<float> out) const override;
  void prepare_visibility(std::span<const Vec3f>) override {}

 private:
  double radius_, albedo_;
};

}  // namespace lightstage::sim
