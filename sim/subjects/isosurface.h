// Triangles from a signed distance.
#pragma once

#include <functional>

#include "sim/subjects/triangle_mesh.h"

namespace lightstage::sim {

struct Box {
  Vec3f low, high;
};

// The surface where `distance` is 0 (negative inside), by naive surface nets: one vertex in every grid cell
// that the surface crosses (Gibson 1998, "Constrained elastic surface nets"), then moved along the gradient
// onto the surface; normals are the gradient's. `distance` may underestimate the true distance but must not
// change faster than twice the way gone: blocks of cells that are farther from the surface than their size
// are skipped. The surface must not touch the box.
TriangleMesh isosurface(const std::function<float(Vec3f)>& distance, Box box, float cell_size);

}  // namespace lightstage::sim
