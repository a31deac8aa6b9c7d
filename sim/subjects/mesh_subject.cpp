#include "sim/subjects/mesh_subject.h"

#include <algorithm>

#include "core/parallel.h"

namespace lightstage::sim {
namespace {

// Rays leave surfaces from this part of the mesh's size above them: far more than float32 rounding, far less
// than any detail.
constexpr float kShadowOffset = 2e-5F;

float size_of(const TriangleMesh& mesh) {
  float largest = 0;
  for (const Vec3f p : mesh.positions) largest = std::max(largest, norm(p));
  return largest;
}

}  // namespace

MeshSubject::MeshSubject(TriangleMesh mesh, std::unique_ptr<const Appearance> appearance)
    : mesh_(std::move(mesh)),
      appearance_(std::move(appearance)),
      scene_(mesh_.positions, mesh_.triangles),
      shadow_offset_(kShadowOffset * size_of(mesh_)) {}

std::optional<SurfaceSample> MeshSubject::sample(core::Vec3 origin, core::Vec3 unit_direction) const {
  const std::optional<RayHit> hit = scene_.first_hit(Vec3f(origin), Vec3f(unit_direction));
  if (!hit) return std::nullopt;
  const Triangle corners = mesh_.triangles[hit->triangle];
  const MeshPoint point{corners, {1 - hit->u - hit->v, hit->u, hit->v}};
  const Vec3f p0 = mesh_.positions[corners[0]], p1 = mesh_.positions[corners[1]], p2 = mesh_.positions[corners[2]];

  SurfaceSample sample;
  sample.triangle = hit->triangle;
  sample.u = hit->u;
  sample.v = hit->v;
  sample.position = point.interpolate(mesh_.positions);
  sample.to_viewer = -Vec3f(unit_direction);
  sample.normal = normalised(point.interpolate(mesh_.normals));
  Vec3f flat = normalised(cross(p1 - p0, p2 - p0));
  if (dot(flat, sample.normal) < 0) flat = -flat;
  // Seen from behind (open meshes): the surface has two sides.
  const float side = dot(flat, sample.to_viewer) < 0 ? -1.0F : 1.0F;
  flat = flat * side;
  sample.normal = sample.normal * side;

  // A flat triangle under a smooth normal would shadow itself before the normal turns away from the light. So
  // rays start from the smooth surface that the normals describe: the mean of the corners' tangent planes,
  // where they lie above the triangle (Hanika 2021, "Hacking the shadow terminator", Ray Tracing Gems II,
  // chapter 4).
  Vec3f lift;
  for (std::size_t i = 0; i < 3; ++i) {
    const Vec3f normal = mesh_.normals[corners[i]] * side;
    const float below = dot(sample.position - mesh_.positions[corners[i]], normal);
    if (below < 0) lift = lift - normal * (below * point.weights[i]);
  }
  sample.shadow_origin = sample.position + lift + flat * shadow_offset_;

  appearance_->apply(point, sample);
  return sample;
}

bool MeshSubject::shadowed(const SurfaceSample& sample, Vec3f light) const {
  return scene_.blocked(sample.shadow_origin, light);
}

void MeshSubject::prepare_visibility(std::span<const Vec3f> lights) {
  light_count_ = lights.size();
  vertex_sees_light_.assign(mesh_.positions.size() * light_count_, 0);
  core::parallel_for(mesh_.positions.size(), 256, [&](std::size_t first, std::size_t last) {
    for (std::size_t vertex = first; vertex < last; ++vertex) {
      const Vec3f normal = mesh_.normals[vertex];
      const Vec3f origin = mesh_.positions[vertex] + normal * shadow_offset_;
      for (std::size_t i = 0; i < light_count_; ++i) {
        const bool sees = dot(normal, lights[i] - origin) > 0 && !scene_.blocked(origin, lights[i]);
        vertex_sees_light_[vertex * light_count_ + i] = sees ? 1 : 0;
      }
    }
  });
}

void MeshSubject::visibility(const SurfaceSample& sample, std::span<const int> light_indices,
                             std::span<float> out) const {
  const Triangle corners = mesh_.triangles[sample.triangle];
  const std::uint8_t* first = vertex_sees_light_.data() + corners[0] * light_count_;
  const std::uint8_t* second = vertex_sees_light_.data() + corners[1] * light_count_;
  const std::uint8_t* third = vertex_sees_light_.data() + corners[2] * light_count_;
  const float w1 = sample.u, w2 = sample.v, w0 = 1 - w1 - w2;
  for (std::size_t k = 0; k < light_indices.size(); ++k) {
    const int i = light_indices[k];
    out[k] = w0 * float(first[i]) + w1 * float(second[i]) + w2 * float(third[i]);
  }
}

}  // namespace lightstage::sim
