#include "sim/subjects/triangle_mesh.h"

#include <algorithm>
#include <string>

#include "core/error.h"

namespace lightstage::sim {

void centre_and_scale(TriangleMesh& mesh, double height, const std::string& what) {
  Vec3f low = mesh.positions.front(), high = low;
  for (const Vec3f p : mesh.positions) {
    low = {std::min(low.x, p.x), std::min(low.y, p.y), std::min(low.z, p.z)};
    high = {std::max(high.x, p.x), std::max(high.y, p.y), std::max(high.z, p.z)};
  }
  const core::Vec3 extent = to_double(high) - to_double(low);
  const double largest = std::max({extent.x, extent.y, extent.z});
  if (!(largest > 0)) throw core::BadInput(what + ": all vertices are at one point");
  const double scale = height / (extent.y > 1e-6 * largest ? extent.y : largest);
  const core::Vec3 centre = (to_double(low) + to_double(high)) / 2;
  for (Vec3f& p : mesh.positions) p = Vec3f((to_double(p) - centre) * scale);
}

}  // namespace lightstage::sim
