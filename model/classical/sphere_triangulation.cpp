#include "model/classical/sphere_triangulation.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "core/error.h"

namespace lightstage::model {

namespace {

__extension__ using Int128 = __int128;

constexpr double kLattice = 0x1p40;
// Over the rounding of a triple product of differences of unit vectors, whose terms are at most 48 (about 1e-14).
constexpr double kCertain = 1e-12;

core::Vec3 unit(core::Vec3 v) {
  return v / core::norm(v);
}

// Any unit vector perpendicular to v.
core::Vec3 across(core::Vec3 v) {
  const core::Vec3 other = std::abs(v.x) < 0.5 * core::norm(v) ? core::Vec3{1, 0, 0} : core::Vec3{0, 1, 0};
  return unit(core::cross(v, other));
}

}  // namespace

SphereTriangulation::SphereTriangulation(std::span<const core::Vec3> points) {
  if (points.empty()) throw core::BadInput("a triangulation needs at least one point");
  for (const core::Vec3 point : points) append(point);
  auto [a, b, c, d] = span_space();
  if (side(a, b, c, d) > 0) std::swap(b, c);
  triangles_ = {triangle(a, b, c), triangle(a, c, d), triangle(a, d, b), triangle(b, d, c)};
  for (std::size_t i = 0; i < points_.size(); ++i)
    if (i != a && i != b && i != c && i != d) enlarge_by(i);
}

void SphereTriangulation::add(core::Vec3 point) {
  append(point);
  enlarge_by(points_.size() - 1);
}

void SphereTriangulation::append(core::Vec3 point) {
  points_.push_back(point);
  const auto rounded = [](double v) { return std::int64_t(std::llround(v * kLattice)); };
  exact_.push_back({rounded(point.x), rounded(point.y), rounded(point.z)});
}

// Four points that do not lie in one plane; where there are none, the points of the sphere that are farthest from what the others span are put in.
std::array<std::size_t, 4> SphereTriangulation::span_space() {
  const core::Vec3 a = points_[0];
  if (points_.size() == 1) append(-a);
  const core::Vec3 b = points_[1];
  if (points_.size() == 2) {
    const core::Vec3 far = -(a + b);
    append(core::norm(far) > 1e-3 ? unit(far) : across(a - b));
  }
  // Three points of a sphere never lie on one line.
  std::size_t d = 3;
  while (d < points_.size() && side(0, 1, 2, d) == 0) ++d;
  if (d == points_.size()) {
    const core::Vec3 normal = unit(core::cross(b - a, points_[2] - a));
    append(core::dot(normal, a) > 0 ? -normal : normal);
  }
  return {0, 1, 2, d};
}

SphereTriangle SphereTriangulation::triangle(std::size_t a, std::size_t b, std::size_t c) const {
  // The longest edge is left out, since the two shortest ones lose the least in rounding.
  const core::Vec3 ab = points_[b] - points_[a], bc = points_[c] - points_[b], ca = points_[a] - points_[c];
  const double lab = core::dot(ab, ab), lbc = core::dot(bc, bc), lca = core::dot(ca, ca);
  core::Vec3 normal = core::cross(ab, bc);
  if (lab >= lbc && lab >= lca) normal = core::cross(bc, ca);
  if (lbc > lab && lbc >= lca) normal = core::cross(ca, ab);
  normal = unit(normal);
  const core::Vec3 to_corner = points_[a] - normal, from_opposite = points_[a] + normal;
  return {{a, b, c}, normal, 2 * std::atan2(core::norm(to_corner), core::norm(from_opposite))};
}

// The sign of det(b - a, c - a, d - a): positive where d lies on the outer side of a, b, c.
int SphereTriangulation::side(std::size_t a, std::size_t b, std::size_t c, std::size_t d) const {
  const Lattice origin = exact_[a];
  const auto from_origin = [&](std::size_t i) {
    return Lattice{exact_[i].x - origin.x, exact_[i].y - origin.y, exact_[i].z - origin.z};
  };
  // Differences have 42 bits, so the sum of three products of three has under 127.
  const Lattice u = from_origin(b), v = from_origin(c), w = from_origin(d);
  const Int128 x = Int128(u.y) * v.z - Int128(u.z) * v.y;
  const Int128 y = Int128(u.z) * v.x - Int128(u.x) * v.z;
  const Int128 z = Int128(u.x) * v.y - Int128(u.y) * v.x;
  const Int128 sum = x * w.x + y * w.y + z * w.z;
  return sum > 0 ? 1 : sum < 0 ? -1 : 0;
}

bool SphereTriangulation::is_outside(const SphereTriangle& face, std::size_t point) const {
  const auto [a, b, c] = face.corners;
  const core::Vec3 p = points_[a];
  const double volume = core::dot(core::cross(points_[b] - p, points_[c] - p), points_[point] - p);
  return std::abs(volume) > kCertain ? volume > 0 : side(a, b, c, point) > 0;
}

// What the point sees of the hull goes; its horizon is joined to the point. A face in whose plane the point lies counts as not seen: the new
// face beside it then lies in the same plane.
void SphereTriangulation::enlarge_by(std::size_t point) {
  std::vector<std::pair<std::size_t, std::size_t>> edges;  // of the faces that are seen
  std::size_t kept = 0;
  for (SphereTriangle& face : triangles_) {
    if (!is_outside(face, point)) {
      triangles_[kept++] = face;
      continue;
    }
    const auto [a, b, c] = face.corners;
    for (const auto& edge : {std::pair(a, b), std::pair(b, c), std::pair(c, a)}) edges.push_back(edge);
  }
  triangles_.resize(kept);
  std::sort(edges.begin(), edges.end());
  for (const auto& [from, to] : edges)
    if (!std::binary_search(edges.begin(), edges.end(), std::pair(to, from)))
      triangles_.push_back(triangle(from, to, point));
}

}  // namespace lightstage::model
