#include "sim/subjects/head.h"

#include "sim/subjects/head_skin.h"
#include "sim/subjects/mesh_subject.h"

namespace lightstage::sim {

std::unique_ptr<Subject> make_head(std::uint64_t seed, double height) {
  constexpr float kCell = 0.24F;  // centimetres
  const HeadShape shape(seed);
  TriangleMesh mesh = isosurface([&](Vec3f p) { return shape.distance(p); }, shape.bounds(), kCell);
  const Vec3f before = mesh.positions.front(), far_before = mesh.positions.back();
  centre_and_scale(mesh, height, "procedural head");
  const Vec3f after = mesh.positions.front(), far_after = mesh.positions.back();
  const float scale = norm(far_after - after) / norm(far_before - before);
  return std::make_unique<MeshSubject>(std::move(mesh), make_head_skin(shape, {after - before * scale, scale}, seed));
}

}  // namespace lightstage::sim
