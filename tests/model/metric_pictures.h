// Pictures for tests of error measures, and the window of SSIM as its definition says.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>

#include "core/image.h"

namespace lightstage::test {

inline core::Image constant(int height, int width, int channels, float value) {
  core::Image image(height, width, channels);
  std::fill(image.values().begin(), image.values().end(), value);
  return image;
}

// Even in [0, 1).
inline core::Image noise(core::ImageSize size, std::uint32_t seed) {
  core::Image image(size);
  for (float& v : image.values()) {
    seed = seed * 1664525u + 1013904223u;
    v = float(seed >> 8) / float(1 << 24);
  }
  return image;
}

inline core::Image mirrored(const core::Image& image) {
  core::Image result(image.size());
  for (int y = 0; y < image.height(); ++y)
    for (int x = 0; x < image.width(); ++x)
      for (int c = 0; c < image.channels(); ++c) result(y, x, c) = image(y, image.width() - 1 - x, c);
  return result;
}

// Means and (co)variances under a Gaussian of 1.5 pixels, 11 by 11; beyond the border pictures are mirrored about the outermost pixels.
struct SsimWindow {
  double mean_a = 0, mean_b = 0, variance_a = 0, variance_b = 0, covariance = 0;
};

inline SsimWindow plain_ssim_window(const core::Image& a, const core::Image& b, int y, int x, int c) {
  const auto reflect = [](int i, int n) {
    if (n == 1) return 0;
    while (i < 0 || i >= n) i = i < 0 ? -i : 2 * (n - 1) - i;
    return i;
  };
  double weight = 0, ma = 0, mb = 0, aa = 0, bb = 0, ab = 0;
  for (int dy = -5; dy <= 5; ++dy)
    for (int dx = -5; dx <= 5; ++dx) {
      const double w = std::exp(-double(dx * dx + dy * dy) / (2 * 1.5 * 1.5));
      const double va = double(a(reflect(y + dy, a.height()), reflect(x + dx, a.width()), c));
      const double vb = double(b(reflect(y + dy, b.height()), reflect(x + dx, b.width()), c));
      weight += w;
      ma += w * va;
      mb += w * vb;
      aa += w * va * va;
      bb += w * vb * vb;
      ab += w * va * vb;
    }
  ma /= weight;
  mb /= weight;
  return {ma, mb, aa / weight - ma * ma, bb / weight - mb * mb, ab / weight - ma * mb};
}

}  // namespace lightstage::test
