#include "align/moving_pictures.h"

#include <numbers>
#include <random>

namespace lightstage::test {

Texture::Texture(std::uint64_t seed) {
  std::mt19937_64 random(seed);
  std::uniform_real_distribution<double> uniform(0, 1);
  for (int i = 0; i < 24; ++i) {
    const double wavelength = 5 * std::pow(8.0, uniform(random));  // 5 to 40 pixels
    const double angle = 2 * std::numbers::pi * uniform(random);
    const double k = 2 * std::numbers::pi / wavelength;
    waves_.push_back({k * std::cos(angle), k * std::sin(angle), 2 * std::numbers::pi * uniform(random), 0.09});
  }
}

double Texture::operator()(double x, double y) const {
  double sum = 0;
  for (const Wave& w : waves_) sum += w.amplitude * std::sin(w.kx * x + w.ky * y + w.phase);
  return 0.4 * std::exp(1.2 * sum);
}

core::Image picture_of(const Texture& texture, int height, int width) {
  return moved_picture_of(texture, height, width, [](double, double) { return std::pair{0.0, 0.0}; });
}

core::Image moved_picture_of(const Texture& texture, int height, int width, const Motion& motion) {
  core::Image image(height, width, 1);
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      // Which p comes to (x, y): a fixed point, since motions here change slowly.
      double px = x, py = y;
      for (int i = 0; i < 30; ++i) {
        const auto [dx, dy] = motion(px, py);
        px = x - dx;
        py = y - dy;
      }
      image(y, x) = float(texture(px, py));
    }
  }
  return image;
}

align::FlowField flow_of(const Motion& motion, int height, int width) {
  align::FlowField flow(height, width, 2);
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      const auto [dx, dy] = motion(x, y);
      flow(y, x, 0) = float(dx);
      flow(y, x, 1) = float(dy);
    }
  }
  return flow;
}

core::Image noisy(const core::Image& image, double exposure, std::uint64_t seed) {
  constexpr double kFullWell = 12000, kReadNoise = 6, kCodes = 4095;
  std::mt19937_64 random(seed);
  std::normal_distribution<double> normal(0, 1);
  core::Image result = image;
  for (float& v : result.values()) {
    const double electrons = double(v) * exposure * kFullWell;
    const double seen = (electrons + normal(random) * std::sqrt(electrons + kReadNoise * kReadNoise)) / kFullWell;
    v = float(std::round(std::min(seen, 1.0) * kCodes) / kCodes / exposure);
  }
  return result;
}

double median_end_point_error(const align::FlowField& a, const align::FlowField& b, int border) {
  std::vector<double> errors;
  for (int y = border; y < a.height() - border; ++y) {
    for (int x = border; x < a.width() - border; ++x) {
      errors.push_back(std::hypot(double(a(y, x, 0)) - double(b(y, x, 0)), double(a(y, x, 1)) - double(b(y, x, 1))));
    }
  }
  std::nth_element(errors.begin(), errors.begin() + std::ptrdiff_t(errors.size() / 2), errors.end());
  return errors[errors.size() / 2];
}

double psnr(const core::Image& a, const core::Image& b, int border) {
  double sum = 0;
  std::size_t count = 0;
  for (int y = border; y < a.height() - border; ++y) {
    for (int x = border; x < a.width() - border; ++x) {
      sum += std::pow(double(a(y, x)) - double(b(y, x)), 2);
      ++count;
    }
  }
  return -10 * std::log10(sum / double(count));
}

}  // namespace lightstage::test
