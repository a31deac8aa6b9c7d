#include "sim/devices/lens_blur.h"

#include "core/parallel.h"

namespace lightstage::sim {

namespace {

// One side and the middle of the kernel, normalised over both sides.
std::vector<float> half_kernel(double sigma_px) {
  const int radius = std::max(1, int(std::ceil(4 * sigma_px)));
  std::vector<double> weights;
  double sum = 0;
  for (int i = 0; i <= radius; ++i) {
    weights.push_back(std::exp(-0.5 * i * i / (sigma_px * sigma_px)));
    sum += (i == 0 ? 1 : 2) * weights.back();
  }
  std::vector<float> kernel;
  for (const double weight : weights) kernel.push_back(float(weight / sum));
  return kernel;
}

// Along rows (dx = 1) or columns (dy = 1).
core::Image blur_along(core::ImageView picture, const std::vector<float>& kernel, int dx, int dy) {
  core::Image out(picture.size());
  const int height = picture.height(), width = picture.width();
  const auto at = [&](int y, int x, int c) {
    return picture(std::clamp(y, 0, height - 1), std::clamp(x, 0, width - 1), c);
  };
  core::parallel_for(std::size_t(height), 16, [&](std::size_t first, std::size_t last) {
    for (int y = int(first); y < int(last); ++y) {
      for (int x = 0; x < width; ++x) {
        for (int c = 0; c < picture.channels(); ++c) {
          float sum = kernel[0] * picture(y, x, c);
          for (int i = 1; i < int(kernel.size()); ++i) {
            sum += kernel[std::size_t(i)] * (at(y - i * dy, x - i * dx, c) + at(y + i * dy, x + i * dx, c));
          }
          out(y, x, c) = sum;
        }
      }
    }
  });
  return out;
}

}  // namespace

core::Image lens_blur(core::ImageView picture, double sigma_px) {
  if (sigma_px == 0) return core::Image(picture);
  const std::vector<float> kernel = half_kernel(sigma_px);
  return blur_along(blur_along(picture, kernel, 1, 0), kernel, 0, 1);
}

}  // namespace lightstage::sim
