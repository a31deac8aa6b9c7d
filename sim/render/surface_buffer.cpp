#include "sim/render/surface_buffer.h"

#include <algorithm>
#include <numbers>
#include <tuple>

#include "core/parallel.h"
#include "sim/scene/random.h"

namespace lightstage::sim {
namespace {

// A unit vector about the normal with density cos/pi, for (a, b) in [0, 1)^2; the frame is Duff et al. 2017,
// "Building an orthonormal basis, revisited".
core::Vec3 cosine_direction(Vec3f normal, double a, double b) {
  const core::Vec3 n = to_double(normal);
  const double sign = std::copysign(1.0, n.z);
  const double c = -1 / (sign + n.z);
  const double d = n.x * n.y * c;
  const core::Vec3 tangent{1 + sign * n.x * n.x * c, sign * d, -sign * n.x};
  const core::Vec3 bitangent{d, sign + n.y * n.y * c, -n.y};
  const double radius = std::sqrt(a), angle = 2 * std::numbers::pi * b;
  const core::Vec3 direction =
      tangent * (radius * std::cos(angle)) + bitangent * (radius * std::sin(angle)) + n * std::sqrt(1 - a);
  return direction / core::norm(direction);
}

// Roberts' R2 sequence (2018, "The unreasonable effectiveness of quasirandom sequences"), shifted on the
// torus.
void add_bounces(const Subject& subject, const SurfaceSample& sample, std::uint64_t place,
                 std::vector<std::optional<SurfaceSample>>& bounces) {
  const double shift_a = uniform(place, 0), shift_b = uniform(place, 1);
  for (int i = 0; i < kBounceRays; ++i) {
    double whole = 0;
    const double a = std::modf(shift_a + 0.7548776662466927 * i, &whole);
    const double b = std::modf(shift_b + 0.5698402909980532 * i, &whole);
    bounces.push_back(subject.sample(to_double(sample.shadow_origin), cosine_direction(sample.normal, a, b)));
    if (bounces.back()) bounces.back()->f0 = 0;  // diffuse light only: a path through a highlight would be a hot pixel
  }
}

auto fields(const core::CameraModel& c) {
  return std::tie(c.width, c.height, c.fx, c.fy, c.cx, c.cy, c.k1, c.k2, c.k3, c.p1, c.p2,
                  c.stage_from_camera.rotation.rows, c.stage_from_camera.translation);
}

bool same_pose(const core::RigidTransform& a, const core::RigidTransform& b) {
  return a.rotation.rows == b.rotation.rows && a.translation == b.translation;
}

}  // namespace

SurfaceBuffer trace(const Subject& subject, std::shared_ptr<const SampleGrid> grid,
                    const core::RigidTransform& subject_from_camera, bool bounce) {
  SurfaceBuffer buffer;
  buffer.grid = std::move(grid);
  buffer.rows.resize(std::size_t(buffer.grid->rows()));
  core::parallel_for(buffer.rows.size(), 4, [&](std::size_t first, std::size_t last) {
    for (std::size_t y = first; y < last; ++y) {
      SurfaceBuffer::Row& row = buffer.rows[y];
      for (int x = 0; x < buffer.grid->columns(); ++x) {
        const core::Vec3 direction = subject_from_camera.rotation * buffer.grid->ray_in_camera(int(y), x);
        std::optional<SurfaceSample> sample = subject.sample(subject_from_camera.translation, direction);
        if (!sample) continue;
        sample->column = x;
        if (bounce) add_bounces(subject, *sample, mix(y, std::uint64_t(x)), row.bounces);
        row.samples.push_back(*sample);
      }
    }
  });
  return buffer;
}

SurfaceCache::SurfaceCache(const Subject& subject, int samples_per_side, bool bounce, std::size_t cameras)
    : subject_(subject),
      samples_per_side_(samples_per_side),
      bounce_(bounce),
      capacity_(std::max<std::size_t>(cameras, 1)) {}

std::shared_ptr<const SurfaceBuffer> SurfaceCache::get(const core::CameraModel& camera,
                                                       const core::RigidTransform& stage_from_subject) {
  std::shared_ptr<const SampleGrid> grid;
  {
    const std::scoped_lock lock(mutex_);
    const auto found = std::find_if(entries_.begin(), entries_.end(),
                                    [&](const Entry& entry) { return fields(entry.camera) == fields(camera); });
    if (found != entries_.end()) {
      entries_.splice(entries_.begin(), entries_, found);
      if (same_pose(found->stage_from_subject, stage_from_subject)) return found->buffer;
      grid = found->buffer->grid;
    }
  }
  if (!grid) grid = std::make_shared<const SampleGrid>(camera, samples_per_side_);
  const core::RigidTransform subject_from_stage = stage_from_subject.inverse();
  const core::RigidTransform subject_from_camera{subject_from_stage.rotation * camera.stage_from_camera.rotation,
                                                 subject_from_stage.apply(camera.stage_from_camera.translation)};
  auto buffer = std::make_shared<const SurfaceBuffer>(trace(subject_, grid, subject_from_camera, bounce_));
  const std::scoped_lock lock(mutex_);
  entries_.remove_if([&](const Entry& entry) { return fields(entry.camera) == fields(camera); });
  entries_.push_front({camera, stage_from_subject, buffer});
  if (entries_.size() > capacity_) entries_.pop_back();
  return buffer;
}

}  // namespace lightstage::sim
