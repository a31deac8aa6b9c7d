#include "model/colour_gradients.h"

#include <algorithm>
#include <numbers>

#include "core/sphere.h"
#include "model/picture_sum.h"

namespace lightstage::model {
namespace {

constexpr double kLargestCell = 2;  // medians

std::vector<double> solid_angles(std::span<const core::Direction> lights) {
  std::vector<double> cells = core::voronoi_solid_angles(lights);
  std::vector<double> sorted = cells;
  const auto middle = sorted.begin() + std::ptrdiff_t(sorted.size() / 2);
  std::nth_element(sorted.begin(), middle, sorted.end());
  for (double& cell : cells) cell = std::min(cell, kLargestCell * *middle);
  return cells;
}

}  // namespace

std::array<std::vector<core::Vec3>, 2> colour_gradient_weights(std::span<const core::Direction> lights) {
  const std::vector<double> cells = solid_angles(lights);
  std::array<std::vector<core::Vec3>, 2> weights;
  for (std::size_t i = 0; i < lights.size(); ++i) {
    const core::Vec3 half{0.5, 0.5, 0.5}, place = 0.5 * lights[i].vec();
    const double share = cells[i] / std::numbers::pi;
    weights[0].push_back(share * (half + place));
    weights[1].push_back(share * (half - place));
  }
  return weights;
}

std::array<core::Image, 2> colour_gradients(const core::OlatScan& scan) {
  const auto weights = colour_gradient_weights(scan.directions());
  std::array<core::Image, 2> pictures;
  for (std::size_t i = 0; i < pictures.size(); ++i) {
    PictureSum sum({scan.image_size().height, scan.image_size().width, 3});
    sum.add(scan, weights[i]);
    pictures[i] = sum.result();
  }
  return pictures;
}

}  // namespace lightstage::model
