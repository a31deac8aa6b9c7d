// What stands on the stage, as the renderer sees it. Everything here is in the subject's own frame: a moving
// subject moves the rays instead, and its acceleration structure is built once.
#pragma once

#include <cstdint>
#include <optional>
#include <span>

#include "sim/render/vec3f.h"

namespace lightstage::sim {

// A point of a surface as seen along one ray.
struct SurfaceSample {
  Vec3f position;
  Vec3f normal;         // for shading, unit, on the viewer's side
  Vec3f shadow_origin;  // where rays leave the surface without meeting it again
  Vec3f to_viewer;      // unit
  Vec3f albedo;         // diffuse, RGB, 0 to 1
  float alpha = 1;      // GGX width
  float f0 = 0;         // reflectance at normal incidence; 0: no specular part at all
  std::uint32_t triangle = 0;
  float u = 0, v = 0;  // barycentric, of corners 1 and 2
  int column = 0;      // of the sample grid
};

class Subject {
 public:
  virtual ~Subject() = default;

  // The nearest surface along a ray.
  virtual std::optional<SurfaceSample> sample(core::Vec3 origin, core::Vec3 unit_direction) const = 0;

  // True when the subject itself stands between a sample and a light that is on the sample's side of the
  // surface.
  virtual bool shadowed(const SurfaceSample& sample, Vec3f light) const = 0;

  // The share of light 0 to 1 that reaches the sample from each of the stage lights named by index: a cheap
  // approximation of `shadowed` for patterns of many lights. Call prepare_visibility first.
  virtual void visibility(const SurfaceSample& sample, std::span<const int> light_indices,
                          std::span<float> out) const = 0;
  // Makes `visibility` ready for lights at these positions. Not thread-safe.
  virtual void prepare_visibility(std::span<const Vec3f> lights) = 0;
};

}  // namespace lightstage::sim
