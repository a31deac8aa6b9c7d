#include "sim/print.h"

#include <algorithm>
#include <cmath>
#include <vector>

#include "core/error.h"
#include "core/parallel.h"

namespace lightstage::sim {

namespace {

using core::Vec3;

constexpr int kSide = 4;  // samples a pixel along each axis
constexpr int kCell =
    4;  // pixels between rays that are computed: in between, distortion is linear to a thousandth of a pixel

// Samples of the picture convolved with blur and pixel: weights about a pixel's middle, from sample -radius to radius - 1.
std::vector<float> kernel_of(double blur_px) {
  const double sigma = std::max(blur_px, 1e-3) * kSide;
  const int radius = kSide / 2 + int(std::ceil(3.5 * sigma));
  std::vector<float> weights;
  const auto integral = [&](double x) { return 0.5 * std::erf(x / (std::sqrt(2.0) * sigma)); };
  double sum = 0;
  for (int k = -radius; k < radius; ++k) {
    // Gaussian over the pixel's box, at the sample's middle.
    const double x = k + 0.5;
    const double w = integral(x + 0.5 * kSide) - integral(x - 0.5 * kSide);
    weights.push_back(float(w));
    sum += w;
  }
  for (float& w : weights) w = float(double(w) / sum);
  return weights;
}

// The point of the plane z = 1 that the pixel looks at; NaN where the lens has no ray.
Vec3 plane_point(const core::CameraModel& camera, double x, double y) {
  try {
    const Vec3 ray = camera.ray_in_camera({x, y});
    return ray / ray.z;
  } catch (const core::BadInput&) {
    return {NAN, NAN, NAN};
  }
}

}  // namespace

core::Image photograph(const core::CameraModel& camera, const Print& print,
                       const core::RigidTransform& stage_from_print, double blur_px, float surroundings) {
  if (print.picture.empty() || print.picture.channels() != 1 || !(print.metres_per_pixel > 0)) {
    throw core::BadInput("a print needs a picture of one channel and a size");
  }
  const std::vector<float> kernel = kernel_of(blur_px);
  const int radius = int(kernel.size()) / 2;
  const core::RigidTransform print_from_stage = stage_from_print.inverse();
  const Vec3 eye = print_from_stage.apply(camera.centre());
  const core::Mat3 print_from_camera = print_from_stage.rotation * camera.stage_from_camera.rotation;

  const auto value_towards = [&](double x, double y) {
    const Vec3 d = print_from_camera * Vec3{x, y, 1};
    // Only the front is printed: it is seen by eyes at z < 0.
    if (!(eye.z < 0) || !(d.z > 0)) return surroundings;
    const Vec3 p = eye + d * (-eye.z / d.z);
    const double column = p.x / print.metres_per_pixel + print.origin_px;
    const double row = p.y / print.metres_per_pixel + print.origin_px;
    if (!(column >= 0 && row >= 0 && column < print.picture.width() && row < print.picture.height())) {
      return surroundings;
    }
    return print.picture(int(row), int(column));
  };

  core::Image picture(camera.height, camera.width, 1);
  constexpr std::size_t kRowsAtATime = 32;
  const int margin = radius / kSide + 1;  // pixels around that the kernel reaches
  const int across = camera.width + 2 * margin;
  core::parallel_for(std::size_t(camera.height), kRowsAtATime, [&](std::size_t first, std::size_t last) {
    const int from = int(first) - margin, rows = int(last - first) + 2 * margin;
    const int cells_across = (across + kCell - 1) / kCell, cells_down = (rows + kCell - 1) / kCell;
    std::vector<Vec3> corners;
    for (int r = 0; r <= cells_down; ++r) {
      for (int c = 0; c <= cells_across; ++c) {
        corners.push_back(plane_point(camera, c * kCell - margin - 0.5, from + r * kCell - 0.5));
      }
    }
    // Samples, and their sums along each row.
    const int fine_rows = rows * kSide, fine_columns = across * kSide;
    std::vector<float> fine(static_cast<std::size_t>(fine_columns));
    std::vector<float> summed(std::size_t(fine_rows) * std::size_t(camera.width));
    constexpr int kFineCell = kCell * kSide;
    for (int fine_row = 0; fine_row < fine_rows; ++fine_row) {
      const Vec3* top = &corners[std::size_t(fine_row / kFineCell) * std::size_t(cells_across + 1)];
      const Vec3* bottom = top + cells_across + 1;
      const double v = (fine_row % kFineCell + 0.5) / kFineCell;
      for (int c = 0; c < cells_across; ++c) {
        const Vec3 left = top[c] * (1 - v) + bottom[c] * v, right = top[c + 1] * (1 - v) + bottom[c + 1] * v;
        for (int s = 0; s < kFineCell && c * kFineCell + s < fine_columns; ++s) {
          const double u = (s + 0.5) / kFineCell;
          const double x = left.x * (1 - u) + right.x * u, y = left.y * (1 - u) + right.y * u;
          fine[std::size_t(c * kFineCell + s)] =
              std::isfinite(x) && std::isfinite(y) ? value_towards(x, y) : surroundings;
        }
      }
      for (int c = 0; c < camera.width; ++c) {
        const float* start = fine.data() + (c + margin) * kSide + kSide / 2 - radius;
        float sum = 0;
        for (std::size_t k = 0; k < kernel.size(); ++k) sum += kernel[k] * start[k];
        summed[std::size_t(fine_row) * std::size_t(camera.width) + std::size_t(c)] = sum;
      }
    }
    for (int y = int(first); y < int(last); ++y) {
      const int start = (y - from) * kSide + kSide / 2 - radius;
      for (int c = 0; c < camera.width; ++c) {
        float sum = 0;
        for (std::size_t k = 0; k < kernel.size(); ++k) {
          sum += kernel[k] * summed[(std::size_t(start) + k) * std::size_t(camera.width) + std::size_t(c)];
        }
        picture(y, c) = sum;
      }
    }
  });
  return picture;
}

}  // namespace lightstage::sim
