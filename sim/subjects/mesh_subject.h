// A triangle mesh on the stage.
#pragma once

#include <memory>

#include "sim/subjects/triangle_mesh.h"

namespace lightstage::sim {

class MeshSubject : public Subject {
 public:
  MeshSubject(TriangleMesh mesh, std::unique_ptr<const Appearance> appearance);

  std::optional<SurfaceSample> sample(core::Vec3 origin, core::Vec3 unit_direction) const override;
  bool shadowed(const SurfaceSample& sample, Vec3f light) const override;
  // Shadow rays are shot from every vertex once, and their answers interpolated over triangles. Right for a
  // subject that moves by millimetres among lights at a distance of a metre and more, except that shadow
  // edges are as soft as triangles are large. Costs one byte a vertex and light.
  void prepare_visibility(std::span<const Vec3f> lights) override;
  void visibility(const SurfaceSample& sample, std::span<const int> light_indices, std::span<float> out) const override;

 private:
  TriangleMesh mesh_;
  std::unique_ptr<const Appearance> appearance_;
  RayScene scene_;
  float shadow_offset_;
  std::size_t light_count_ = 0;
  std::vector<std::uint8_t> vertex_sees_light_;  // [vertex][light]
};

}  // namespace lightstage::sim
