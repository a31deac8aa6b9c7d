// Triangle meshes, and what their surfaces are made of.
#pragma once

#include <array>
#include <string>
#include <vector>

#include "sim/render/ray_scene.h"
#include "sim/render/subject.h"

namespace lightstage::sim {

struct TriangleMesh {
  std::vector<Vec3f> positions;  // metres
  std::vector<Vec3f> normals;    // one a position, unit, outwards
  std::vector<Triangle> triangles;
};

// Moves the mesh so that its bounding box is centred on the origin and scales it to `height` along y (to a
// largest side of `height` where it is flat in y). Throws BadInput naming `what` when all vertices coincide.
void centre_and_scale(TriangleMesh& mesh, double height, const std::string& what);

// A point of a triangle: corners and their weights.
struct MeshPoint {
  Triangle corners;
  std::array<float, 3> weights;

  template <class T>
  T interpolate(const std::vector<T>& values) const {
    return values[corners[0]] * weights[0] + values[corners[1]] * weights[1] + values[corners[2]] * weights[2];
  }
};

// The material along a surface.
class Appearance {
 public:
  virtual ~Appearance() = default;
  // Sets albedo, alpha and f0, and may bend the normal; position, normal and to_viewer are given.
  virtual void apply(const MeshPoint& point, SurfaceSample& sample) const = 0;
};

}  // namespace lightstage::sim
