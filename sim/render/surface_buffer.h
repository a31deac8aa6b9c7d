// What a camera sees of a subject in one pose: everything about a picture that does not depend on the lights.
#pragma once

#include <list>
#include <memory>
#include <mutex>
#include <vector>

#include "core/camera_model.h"
#include "sim/render/sample_grid.h"
#include "sim/render/subject.h"

namespace lightstage::sim {

// Rays a primary sample sends on for one bounce of diffuse light.
constexpr int kBounceRays = 4;

struct SurfaceBuffer {
  struct Row {
    std::vector<SurfaceSample> samples;  // by column; columns that see nothing are absent
    std::vector<std::optional<SurfaceSample>>
        bounces;  // kBounceRays a sample (none at all without bounce); empty: escaped
  };
  std::shared_ptr<const SampleGrid> grid;
  std::vector<Row> rows;
};

// Shoots the grid's rays. The bounce's directions are cosine-distributed, from a low-discrepancy sequence
// shifted by the sample's place in the grid, so the same for every thread count.
SurfaceBuffer trace(const Subject& subject, std::shared_ptr<const SampleGrid> grid,
                    const core::RigidTransform& subject_from_camera, bool bounce);

// Keeps the last buffer of each of a few cameras: at a still pose, one light after the other costs shading
// only. May be called from several threads.
class SurfaceCache {
 public:
  SurfaceCache(const Subject& subject, int samples_per_side, bool bounce, std::size_t cameras);

  std::shared_ptr<const SurfaceBuffer> get(const core::CameraModel& camera,
                                           const core::RigidTransform& stage_from_subject);

 private:
  struct Entry {
    core::CameraModel camera;
    core::RigidTransform stage_from_subject;
    std::shared_ptr<const SurfaceBuffer> buffer;
  };
  const Subject& subject_;
  int samples_per_side_;
  bool bounce_;
  std::size_t capacity_;
  std::mutex mutex_;
  std::list<Entry> entries_;  // most recently used first
};

}  // namespace lightstage::sim
