// FLIP against values worked out by hand, against its equations written out without any shortcut, and against what an eye would say.
#include <algorithm>
#include <array>
#include <catch2/catch.hpp>
#include <cmath>
#include <cstdint>

#include "core/display.h"
#include "core/error.h"
#include "model/flip.h"
#include "model/metric_pictures.h"
#include "model/metrics.h"

namespace lightstage {

namespace {

using core::Image;
using Colour = std::array<double, 3>;

Image constant(int height, int width, const std::vector<float>& colour) {
  Image image(height, width, int(colour.size()));
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x)
      for (int c = 0; c < image.channels(); ++c) image(y, x, c) = colour[std::size_t(c)];
  return image;
}

// The publication's pipeline for one pixel, with two-dimensional filters summed as they are defined.
class PlainFlip {
 public:
  PlainFlip(const Image& a, const Image& b, double pixels_per_degree) : a_(a), b_(b), ppd_(pixels_per_degree) {}

  double at(int y, int x) const {
    const double colour = colour_error(seen(a_, y, x), seen(b_, y, x));
    double edge_a = 0, point_a = 0, edge_b = 0, point_b = 0;
    features(a_, y, x, edge_a, point_a);
    features(b_, y, x, edge_b, point_b);
    const double feature = std::sqrt(std::max(std::abs(edge_a - edge_b), std::abs(point_a - point_b)) / std::sqrt(2.0));
    return std::pow(colour, 1 - std::min(feature, 1.0));
  }

 private:
  static Colour xyz(const Colour& rgb) {  // relative to D65
    const double x = 0.4123907993 * rgb[0] + 0.3575843394 * rgb[1] + 0.1804807884 * rgb[2];
    const double y = 0.2126390059 * rgb[0] + 0.7151686788 * rgb[1] + 0.0721923154 * rgb[2];
    const double z = 0.0193308187 * rgb[0] + 0.1191947798 * rgb[1] + 0.9505321522 * rgb[2];
    return {x / 0.9504559271, y, z / 1.0890577508};
  }

  static Colour rgb_of(const Colour& relative) {
    const double x = relative[0] * 0.9504559271, y = relative[1], z = relative[2] * 1.0890577508;
    return {3.2409699419 * x - 1.5373831776 * y - 0.4986107603 * z,
            -0.9692436363 * x + 1.8759675015 * y + 0.0415550574 * z,
            0.0556300797 * x - 0.2039769589 * y + 1.0569715142 * z};
  }

  static Colour hunt(const Colour& rgb) {
    const auto f = [](double t) { return t > 216.0 / 24389 ? std::cbrt(t) : (24389.0 / 27 * t + 16) / 116; };
    const Colour v = xyz(rgb);
    const double lightness = 116 * f(v[1]) - 16;
    return {lightness, 0.01 * lightness * 500 * (f(v[0]) - f(v[1])), 0.01 * lightness * 200 * (f(v[1]) - f(v[2]))};
  }

  static double hyab(const Colour& p, const Colour& q) {
    return std::abs(p[0] - q[0]) + std::sqrt((p[1] - q[1]) * (p[1] - q[1]) + (p[2] - q[2]) * (p[2] - q[2]));
  }

  static double colour_error(const Colour& p, const Colour& q) {
    const double largest = std::pow(hyab(hunt({0, 1, 0}), hunt({0, 0, 1})), 0.7);
    const double e = std::pow(hyab(hunt(p), hunt(q)), 0.7), knee = 0.4 * largest;
    return e < knee ? 0.95 / knee * e : 0.95 + (e - knee) / (largest - knee) * 0.05;
  }

  Colour opponent(const Image& image, int y, int x) const {
    y = std::clamp(y, 0, image.height() - 1);
    x = std::clamp(x, 0, image.width() - 1);
    Colour rgb;
    for (int c = 0; c < 3; ++c) rgb[std::size_t(c)] = std::pow(double(image(y, x, image.channels() == 1 ? 0 : c)), 2.2);
    const Colour v = xyz(rgb);
    return {116 * v[1] - 16, 500 * (v[0] - v[1]), 200 * (v[1] - v[2])};
  }

  Colour seen(const Image& image, int y, int x) const {
    const double pi = 3.14159265358979323846;
    const int radius = int(std::ceil(3 * std::sqrt(0.04 / (2 * pi * pi)) * ppd_));
    Colour sums{}, weights{};
    for (int dy = -radius; dy <= radius; ++dy)
      for (int dx = -radius; dx <= radius; ++dx) {
        const double d2 = (dx * dx + dy * dy) / (ppd_ * ppd_);
        const auto gauss = [&](double a, double b) { return a * std::sqrt(pi / b) * std::exp(-pi * pi * d2 / b); };
        const Colour weight{gauss(1, 0.0047), gauss(1, 0.0053), gauss(34.1, 0.04) + gauss(13.5, 0.025)};
        const Colour value = opponent(image, y + dy, x + dx);
        for (std::size_t c = 0; c < 3; ++c) {
          sums[c] += weight[c] * value[c];
          weights[c] += weight[c];
        }
      }
    const double luminance = (sums[0] / weights[0] + 16) / 116;
    Colour rgb = rgb_of({luminance + sums[1] / weights[1] / 500, luminance, luminance - sums[2] / weights[2] / 200});
    for (double& v : rgb) v = std::clamp(v, 0.0, 1.0);
    return rgb;
  }

  void features(const Image& image, int y, int x, double& edge, double& point) const {
    const double sigma = 0.5 * 0.082 * ppd_;
    const int radius = int(std::ceil(3 * sigma));
    // Sums of positive and negative weights apart, along x and y.
    double value[4][2] = {}, weight[4][2] = {};
    for (int dy = -radius; dy <= radius; ++dy)
      for (int dx = -radius; dx <= radius; ++dx) {
        const double g = std::exp(-(dx * dx + dy * dy) / (2 * sigma * sigma));
        const double luminance = (opponent(image, y + dy, x + dx)[0] + 16) / 116;
        const double kernels[4] = {-dx * g, -dy * g, (dx * dx / (sigma * sigma) - 1) * g,
                                   (dy * dy / (sigma * sigma) - 1) * g};
        for (int k = 0; k < 4; ++k) {
          const int sign = kernels[k] > 0 ? 0 : 1;
          value[k][sign] += kernels[k] * luminance;
          weight[k][sign] += std::abs(kernels[k]);
        }
      }
    double response[4];
    for (int k = 0; k < 4; ++k) response[k] = value[k][0] / weight[k][0] + value[k][1] / weight[k][1];
    edge = std::hypot(response[0], response[1]);
    point = std::hypot(response[2], response[3]);
  }

  const Image& a_;
  const Image& b_;
  double ppd_;
};

}  // namespace

TEST_CASE("FLIP of flat colours, by hand") {
  // Black and white: no features; HyAB is 100, to the power 0.7 25.119. Green and blue, the farthest apart, have 203.26, which gives 41.27; so
  // 0.95 + (25.119 - 16.508) / (41.27 - 16.508) 0.05 = 0.9674.
  CHECK(model::flip(constant(9, 7, {0, 0, 0}), constant(9, 7, {1, 1, 1}), {}) == Approx(0.9674).margin(2e-4));
  CHECK(model::flip(constant(9, 7, {0}), constant(9, 7, {1}), {}) == Approx(0.9674).margin(2e-4));
  CHECK(model::flip(constant(1, 1, {0, 1, 0}), constant(1, 1, {0, 0, 1}), {}) == Approx(1).margin(1e-6));
  // A grey of lightness 50 against black: 50^0.7 = 15.462, 0.95 / 16.508 times that.
  const float grey = core::display_encode(0.18418651851244416f);
  CHECK(model::flip(constant(4, 4, {grey}), constant(4, 4, {0}), {}) == Approx(0.8898).margin(2e-4));
}

TEST_CASE("FLIP is what its equations say, written out plainly") {
  for (const double ppd : {8.0, 67.0206}) {
    for (const int channels : {1, 3}) {
      const Image a = test::noise({19, 23, channels}, 1);
      Image b = test::noise({19, 23, channels}, 2);
      for (std::size_t i = 0; i < b.values().size(); ++i) b.values()[i] = 0.6f * a.values()[i] + 0.4f * b.values()[i];
      for (int y = 5; y < 12; ++y)
        for (int x = 9; x < 23; ++x)
          for (int c = 0; c < channels; ++c) b(y, x, c) *= 0.3f;
      const Image map = model::flip_map(a, b, ppd);
      const PlainFlip plain(a, b, ppd);
      double largest = 0;
      for (const auto& [y, x] : {std::pair(0, 0), {18, 22}, {9, 11}, {5, 9}, {0, 12}, {12, 3}}) {
        CAPTURE(ppd, channels, y, x);
        CHECK(double(map(y, x)) == Approx(plain.at(y, x)).margin(2e-6));
        largest = std::max(largest, plain.at(y, x));
      }
      CHECK(largest > 0.1);
    }
  }
}

TEST_CASE("FLIP sees less of a fine pattern from afar") {
  Image pattern(64, 64, 1);
  for (int y = 0; y < 64; ++y)
    for (int x = 0; x < 64; ++x) pattern(y, x) = (x + y) % 2 == 0 ? 0.4f : 0.6f;
  const float mean = core::display_encode((core::display_decode(0.4f) + core::display_decode(0.6f)) / 2);
  const Image flat = constant(64, 64, {mean});
  double nearer = 1;
  for (const double ppd : {4.0, 30.0, 100.0, 400.0}) {
    const double seen = double(model::flip_map(pattern, flat, ppd)(32, 32));
    CAPTURE(ppd);
    CHECK(seen < nearer);
    nearer = seen;
  }
  CHECK(nearer < 1e-3);
}

TEST_CASE("FLIP stays in [0, 1] at extremes and refuses what it does not know") {
  const Image bright = constant(3, 5, {7, -2, 1e30f}), black = constant(3, 5, {0, 0, 0});
  const Image map = model::flip_map(bright, black);
  for (const float v : map.values()) {
    CHECK(v > 0);
    CHECK(v <= 1);
  }
  CHECK(model::flip(bright, bright, {}) == 0);
  CHECK_THROWS_AS(model::flip_map(black, constant(3, 4, {0, 0, 0})), core::BadInput);
  CHECK_THROWS_AS(model::flip_map(constant(3, 3, {0, 0}), constant(3, 3, {0, 0})), core::BadInput);
  for (const double ppd : {0.5, 1e4, std::nan("")}) CHECK_THROWS_AS(model::flip_map(black, black, ppd), core::BadInput);
}

}  // namespace lightstage
