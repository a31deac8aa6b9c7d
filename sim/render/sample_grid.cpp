#include "sim/render/sample_grid.h"

#include <algorithm>
#include <numbers>

#include "core/parallel.h"

namespace lightstage::sim {

double pixel_response(double offset) {
  constexpr double kScale = 1 / (kLensBlur * std::numbers::sqrt2);
  return 0.5 * (std::erf((offset + 0.5) * kScale) - std::erf((offset - 0.5) * kScale));
}

std::vector<float> filter_weights(int per_side) {
  std::vector<double> weights(std::size_t((2 * kFilterReach + 1) * per_side));
  double sum = 0;
  for (std::size_t i = 0; i < weights.size(); ++i) {
    weights[i] = pixel_response((double(i) + 0.5) / per_side - 0.5 - kFilterReach);
    sum += weights[i];
  }
  std::vector<float> result(weights.size());
  std::transform(weights.begin(), weights.end(), result.begin(), [sum](double w) { return float(w / sum); });
  return result;
}

SampleGrid::SampleGrid(const core::CameraModel& camera, int per_side)
    : per_side_(per_side),
      image_width_(camera.width),
      image_height_(camera.height),
      columns_((camera.width + 2 * kFilterReach) * per_side),
      rows_((camera.height + 2 * kFilterReach) * per_side),
      slopes_(std::size_t(columns_) * std::size_t(rows_)) {
  const auto position = [per_side](std::size_t i) { return (double(i) + 0.5) / per_side - 0.5 - kFilterReach; };
  core::parallel_for(std::size_t(rows_), 8, [&](std::size_t first, std::size_t last) {
    for (std::size_t row = first; row < last; ++row) {
      for (std::size_t column = 0; column < std::size_t(columns_); ++column) {
        const core::Vec3 ray = camera.ray_in_camera({position(column), position(row)});
        slopes_[row * std::size_t(columns_) + column] = {float(ray.x / ray.z), float(ray.y / ray.z)};
      }
    }
  });
}

core::Vec3 SampleGrid::ray_in_camera(int row, int column) const {
  const Slope slope = slopes_[std::size_t(row) * std::size_t(columns_) + std::size_t(column)];
  const double x = double(slope.x), y = double(slope.y);
  const double scale = 1 / std::sqrt(x * x + y * y + 1);
  return {x * scale, y * scale, scale};
}

}  // namespace lightstage::sim
