#include "sim/subjects/isosurface.h"

#include <algorithm>

#include "core/parallel.h"

namespace lightstage::sim {
namespace {

constexpr int kBlock = 4;  // grid nodes a side of the blocks that are skipped together
constexpr std::uint32_t kNoVertex = ~0u;

// Values of the distance at the nodes of a regular grid.
class Grid {
 public:
  Grid(const std::function<float(Vec3f)>& distance, Box box, float step) : low_(box.low), step_(step) {
    const Vec3f extent = box.high - box.low;
    for (std::size_t axis = 0; axis < 3; ++axis) {
      const float length = axis == 0 ? extent.x : axis == 1 ? extent.y : extent.z;
      const int blocks = int(std::ceil(length / (step * kBlock)));
      count_[axis] = std::max(blocks, 1) * kBlock;
    }
    values_.resize(std::size_t(count_[0]) * std::size_t(count_[1]) * std::size_t(count_[2]));
    sample(distance);
  }

  int count(std::size_t axis) const { return count_[axis]; }
  std::size_t index(int x, int y, int z) const {
    return (std::size_t(z) * std::size_t(count_[1]) + std::size_t(y)) * std::size_t(count_[0]) + std::size_t(x);
  }
  Vec3f node(int x, int y, int z) const { return low_ + Vec3f(float(x), float(y), float(z)) * step_; }
  float value(int x, int y, int z) const { return values_[index(x, y, z)]; }

 private:
  void sample(const std::function<float(Vec3f)>& distance) {
    const int bx = count_[0] / kBlock, by = count_[1] / kBlock, bz = count_[2] / kBlock;
    const float half = 0.5F * float(kBlock - 1);
    // From a block's middle to its farthest node, times the steepest change.
    const float reach = 2 * half * step_ * std::sqrt(3.0F);
    core::parallel_for(std::size_t(bx * by * bz), 4, [&](std::size_t first, std::size_t last) {
      for (std::size_t block = first; block < last; ++block) {
        const int x0 = int(block) % bx * kBlock, y0 = int(block) / bx % by * kBlock,
                  z0 = int(block) / (bx * by) * kBlock;
        const float middle = distance(node(x0, y0, z0) + Vec3f(half, half, half) * step_);
        const bool far = std::abs(middle) > reach;
        for (int z = z0; z < z0 + kBlock; ++z) {
          for (int y = y0; y < y0 + kBlock; ++y) {
            for (int x = x0; x < x0 + kBlock; ++x) values_[index(x, y, z)] = far ? middle : distance(node(x, y, z));
          }
        }
      }
    });
  }

  Vec3f low_;
  float step_;
  std::array<int, 3> count_{};
  std::vector<float> values_;
};

// The mean of the points where the cell's twelve edges cross the surface; nothing when none does.
std::optional<Vec3f> cell_vertex(const Grid& grid, int x, int y, int z) {
  Vec3f sum;
  int crossings = 0;
  for (int corner = 0; corner < 8; ++corner) {
    const int cx = x + (corner & 1), cy = y + (corner >> 1 & 1), cz = z + (corner >> 2);
    const float a = grid.value(cx, cy, cz);
    for (int axis = 0; axis < 3; ++axis) {
      if ((corner >> axis & 1) != 0) continue;
      const int ex = cx + (axis == 0), ey = cy + (axis == 1), ez = cz + (axis == 2);
      const float b = grid.value(ex, ey, ez);
      if ((a < 0) == (b < 0)) continue;
      sum = sum + lerp(grid.node(cx, cy, cz), grid.node(ex, ey, ez), a / (a - b));
      ++crossings;
    }
  }
  if (crossings == 0) return std::nullopt;
  return sum * (1 / float(crossings));
}

// By differences between the corners of a tetrahedron: four values instead of six.
Vec3f gradient(const std::function<float(Vec3f)>& distance, Vec3f p, float step) {
  constexpr std::array<Vec3f, 4> kCorners{Vec3f(1, -1, -1), Vec3f(-1, -1, 1), Vec3f(-1, 1, -1), Vec3f(1, 1, 1)};
  Vec3f sum;
  for (const Vec3f corner : kCorners) sum = sum + corner * distance(p + corner * step);
  return sum * (0.25F / step);
}

// Newton's method along the first gradient, for at most half a cell in all: beyond it triangles would fold over.
Vec3f onto_surface(const std::function<float(Vec3f)>& distance, Vec3f p, float cell_size) {
  const Vec3f g = gradient(distance, p, 0.1F * cell_size);
  const float steepness = dot(g, g);
  if (!(steepness > 1e-3F)) return p;
  const float most = 0.25F * cell_size / std::sqrt(steepness);
  for (int step = 0; step < 2; ++step) p = p - g * std::clamp(distance(p) / steepness, -most, most);
  return p;
}

}  // namespace

TriangleMesh isosurface(const std::function<float(Vec3f)>& distance, Box box, float cell_size) {
  const Grid grid(distance, box, cell_size);
  TriangleMesh mesh;
  std::vector<std::uint32_t> vertex_of_cell(
      std::size_t(grid.count(0)) * std::size_t(grid.count(1)) * std::size_t(grid.count(2)), kNoVertex);
  for (int z = 0; z + 1 < grid.count(2); ++z) {
    for (int y = 0; y + 1 < grid.count(1); ++y) {
      for (int x = 0; x + 1 < grid.count(0); ++x) {
        const std::optional<Vec3f> vertex = cell_vertex(grid, x, y, z);
        if (!vertex) continue;
        vertex_of_cell[grid.index(x, y, z)] = std::uint32_t(mesh.positions.size());
        mesh.positions.push_back(*vertex);
      }
    }
  }

  mesh.normals.resize(mesh.positions.size());
  core::parallel_for(mesh.positions.size(), 256, [&](std::size_t first, std::size_t last) {
    for (std::size_t i = first; i < last; ++i) {
      const Vec3f p = mesh.positions[i] = onto_surface(distance, mesh.positions[i], cell_size);
      // Over half a cell: what is smaller cannot be told from noise by triangles of this size.
      mesh.normals[i] = normalised(gradient(distance, p, 0.5F * cell_size));
    }
  });

  // Every grid edge that crosses the surface joins the vertices of its four cells.
  for (int z = 1; z + 1 < grid.count(2); ++z) {
    for (int y = 1; y + 1 < grid.count(1); ++y) {
      for (int x = 1; x + 1 < grid.count(0); ++x) {
        const bool inside = grid.value(x, y, z) < 0;
        for (int axis = 0; axis < 3; ++axis) {
          const bool end_inside = grid.value(x + (axis == 0), y + (axis == 1), z + (axis == 2)) < 0;
          if (inside == end_inside) continue;
          const auto cell = [&](int first, int second) {
            const int dx = axis == 0 ? 0 : axis == 1 ? second : first;
            const int dy = axis == 1 ? 0 : axis == 2 ? second : first;
            const int dz = axis == 2 ? 0 : axis == 0 ? second : first;
            return vertex_of_cell[grid.index(x - dx, y - dy, z - dz)];
          };
          std::array<std::uint32_t, 4> quad{cell(0, 0), cell(1, 0), cell(1, 1), cell(0, 1)};
          if (!inside) std::swap(quad[1], quad[3]);
          const auto& p = mesh.positions;
          if (norm(p[quad[0]] - p[quad[2]]) <= norm(p[quad[1]] - p[quad[3]])) {
            mesh.triangles.push_back({quad[0], quad[1], quad[2]});
            mesh.triangles.push_back({quad[0], quad[2], quad[3]});
          } else {
            mesh.triangles.push_back({quad[1], quad[2], quad[3]});
            mesh.triangles.push_back({quad[1], quad[3], quad[0]});
          }
        }
      }
    }
  }
  return mesh;
}

}  // namespace lightstage::sim
