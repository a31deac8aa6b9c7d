#include "calib/colour_chart.h"

#include <catch2/catch.hpp>
#include <cmath>
#include <limits>
#include <random>

#include "calib/colour/lab.h"
#include "core/error.h"

namespace lightstage::calib {

namespace {

using Matrix = std::array<std::array<double, 3>, 3>;

// A camera whose colours are these of linear Rec. 709 light: the inverse of what is to be found.
constexpr Matrix kCamera{{{0.62, 0.25, 0.05}, {0.18, 0.80, 0.12}, {0.03, 0.22, 0.55}}};

struct Rendering {
  core::Image picture;
  std::array<core::Pixel, 4> corners;
};

// The chart on a grey table, seen in perspective: `corners` of its field of patches in pixels, patches 2.5 wide and 0.25 apart in a black frame. A shade
// falls off to the right by `shade`; noise of a sensor with 8000 electrons at 1.
Rendering render(std::array<core::Pixel, 4> corners, const Matrix& camera, double exposure, double shade,
                 std::uint64_t seed, int width = 480, int height = 360) {
  // Homography from the unit square by solving for its eight unknowns is what the code under test does; here the square's bilinear map with
  // perspective weights, after Heckbert 1989, section 2.2.3.
  const auto& p = corners;
  const double sx = p[0].x - p[1].x + p[2].x - p[3].x, sy = p[0].y - p[1].y + p[2].y - p[3].y;
  const double dx1 = p[1].x - p[2].x, dx2 = p[3].x - p[2].x, dy1 = p[1].y - p[2].y, dy2 = p[3].y - p[2].y;
  const double det = dx1 * dy2 - dx2 * dy1;
  const double g = (sx * dy2 - dx2 * sy) / det, h = (dx1 * sy - sx * dy1) / det;
  const double a = p[1].x - p[0].x + g * p[1].x, b = p[3].x - p[0].x + h * p[3].x, c = p[0].x;
  const double d = p[1].y - p[0].y + g * p[1].y, e = p[3].y - p[0].y + h * p[3].y, f = p[0].y;
  // Inverse by the adjugate.
  const double inv[3][3] = {{e - f * h, c * h - b, b * f - c * e},
                            {f * g - d, a - c * g, c * d - a * f},
                            {d * h - e * g, b * g - a * h, a * e - b * d}};
  static const Triple kLab[24] = {
      {37.986, 13.555, 14.059},  {65.711, 18.130, 17.810},   {49.927, -4.880, -21.925}, {43.139, -13.095, 21.905},
      {55.112, 8.844, -25.399},  {70.719, -33.397, -0.199},  {62.661, 36.067, 57.096},  {40.020, 10.410, -45.964},
      {51.124, 48.239, 16.248},  {30.325, 22.976, -21.587},  {72.532, -23.709, 57.255}, {71.941, 19.363, 67.857},
      {28.778, 14.179, -50.297}, {55.261, -38.342, 31.370},  {42.101, 53.378, 28.190},  {81.733, 4.039, 79.819},
      {51.935, 49.986, -14.574}, {51.038, -28.631, -28.638}, {96.539, -0.425, 1.186},   {81.257, -0.638, -0.335},
      {66.766, -0.734, -0.504},  {50.867, -0.153, -0.270},   {35.656, -0.421, -1.231},  {20.461, -0.079, -0.973}};
  Rendering rendering{core::Image(height, width, 3), corners};
  std::mt19937_64 generator(seed);
  std::normal_distribution<double> normal(0, 1);
  constexpr int kSub = 3;
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      Triple light{0, 0, 0};
      for (int j = 0; j < kSub; ++j) {
        for (int i = 0; i < kSub; ++i) {
          const double px = x + (i + 0.5) / kSub - 0.5, py = y + (j + 0.5) / kSub - 0.5;
          const double w = inv[2][0] * px + inv[2][1] * py + inv[2][2];
          const double u = (inv[0][0] * px + inv[0][1] * py + inv[0][2]) / w * 16.75;
          const double v = (inv[1][0] * px + inv[1][1] * py + inv[1][2]) / w * 11.25;
          Triple colour{0.3, 0.3, 0.3};
          if (u > -0.8 && v > -0.8 && u < 17.55 && v < 12.05) colour = {0.03, 0.03, 0.03};
          const int column = int(std::floor((u - 0.25) / 2.75)), row = int(std::floor((v - 0.25) / 2.75));
          if (column >= 0 && column < 6 && row >= 0 && row < 4 && u - 0.25 - 2.75 * column < 2.5 &&
              v - 0.25 - 2.75 * row < 2.5) {
            colour = rec709_from_lab(kLab[row * 6 + column]);
          }
          for (std::size_t k = 0; k < 3; ++k) light[k] += colour[k] / (kSub * kSub);
        }
      }
      const double falloff = exposure * (1 - shade * x / width);
      for (std::size_t k = 0; k < 3; ++k) {
        const double signal = falloff * (camera[k][0] * light[0] + camera[k][1] * light[1] + camera[k][2] * light[2]);
        const double electrons = 8000 * signal + std::sqrt(std::max(0.0, 8000 * signal) + 9) * normal(generator);
        rendering.picture(y, x, int(k)) = float(std::min(electrons / 8000, 1.0));
      }
    }
  }
  return rendering;
}

constexpr std::array<core::Pixel, 4> kTilted{{{92, 70}, {380, 96}, {402, 270}, {70, 290}}};

// Camera colours of grey light come out as grey, and the rest within this.
double largest_off(const ColourFit& fit, const Matrix& camera, double exposure) {
  double largest = 0;
  for (const Triple& light : {Triple{1, 1, 1}, {0.5, 0.1, 0.1}, {0.1, 0.4, 0.1}, {0.1, 0.1, 0.5}, {0.4, 0.3, 0.1}}) {
    Triple seen{}, found{};
    for (std::size_t r = 0; r < 3; ++r) {
      for (std::size_t c = 0; c < 3; ++c) seen[r] += exposure * camera[r][c] * light[c];
    }
    for (std::size_t r = 0; r < 3; ++r) {
      for (std::size_t c = 0; c < 3; ++c) found[r] += fit.exposure * fit.matrix[r][c] * fit.white_balance[c] * seen[c];
    }
    largest = std::max(largest, delta_e_2000(lab_from_rec709(found), lab_from_rec709(light)));
  }
  return largest;
}

}  // namespace

TEST_CASE("Lab of known colours, and there and back") {
  const Triple white = lab_from_rec709({1, 1, 1});
  CHECK(white[0] == Approx(100).margin(0.001));
  CHECK(std::abs(white[1]) < 0.01);
  CHECK(std::abs(white[2]) < 0.01);
  // sRGB red under D50, as colour management systems give it.
  const Triple red = lab_from_rec709({1, 0, 0});
  CHECK(red[0] == Approx(54.29).margin(0.02));
  CHECK(red[1] == Approx(80.81).margin(0.05));
  CHECK(red[2] == Approx(69.89).margin(0.05));
  for (const Triple& rgb : {Triple{0.2, 0.7, 0.01}, {0, 0, 0}, {-0.01, 0.3, 2}, {1e-4, 2e-4, 1e-4}}) {
    const Triple back = rec709_from_lab(lab_from_rec709(rgb));
    for (std::size_t c = 0; c < 3; ++c) CHECK(back[c] == Approx(rgb[c]).margin(1e-12));
  }
}

TEST_CASE("CIEDE2000 of the pairs published to test it") {
  const struct {
    Triple a, b;
    double difference;
  } kPairs[] = {{{50, 2.6772, -79.7751}, {50, 0, -82.7485}, 2.0425},
                {{50, -1.3802, -84.2814}, {50, 0, -82.7485}, 1.0000},
                {{50, 0, 0}, {50, -1, 2}, 2.3669},
                {{50, 2.4900, -0.0010}, {50, -2.4900, 0.0009}, 7.1792},
                {{50, 2.4900, -0.0010}, {50, -2.4900, 0.0011}, 7.2195},
                {{50, 2.5, 0}, {50, 0, -2.5}, 4.3065},
                {{50, 2.5, 0}, {73, 25, -18}, 27.1492},
                {{60.2574, -34.0099, 36.2677}, {60.4626, -34.1751, 39.4387}, 1.2644},
                {{22.7233, 20.0904, -46.6940}, {23.0331, 14.9730, -42.5619}, 2.0373},
                {{2.0776, 0.0795, -1.1350}, {0.9033, -0.0636, -0.5514}, 0.9082}};
  for (const auto& pair : kPairs) {
    CHECK(delta_e_2000(pair.a, pair.b) == Approx(pair.difference).margin(5e-5));
    CHECK(delta_e_2000(pair.b, pair.a) == Approx(pair.difference).margin(5e-5));
    CHECK(delta_e_2000(pair.a, pair.a) == 0);
  }
}

TEST_CASE("a chart seen in perspective gives the camera's colours") {
  for (const bool upside_down : {false, true}) {
    auto corners = kTilted;
    if (upside_down) corners = {kTilted[2], kTilted[3], kTilted[0], kTilted[1]};
    const Rendering rendering = render(corners, kCamera, 0.8, 0, 3);
    const ChartReading reading = read_chart(rendering.picture, 1);
    for (std::size_t i = 0; i < 4; ++i) {
      CHECK(std::hypot(reading.corners[i].x - corners[i].x, reading.corners[i].y - corners[i].y) < 8);
    }
    CHECK(reading.patches.size() == 24);
    CHECK(reading.patches[0].name == "dark skin");
    const ColourFit fit = fit_colour(reading);
    INFO("mean " << fit.mean_delta_e << ", largest " << fit.largest_delta_e << ", balanced alone "
                 << fit.mean_delta_e_balanced << ", off " << largest_off(fit, kCamera, 0.8));
    CHECK(fit.used >= 23);
    CHECK(fit.mean_delta_e < 0.4);
    CHECK(fit.largest_delta_e < 1.5);
    CHECK(fit.mean_delta_e_balanced > 3);
    CHECK(largest_off(fit, kCamera, 0.8) < 1);
    for (const auto& row : fit.matrix) CHECK(row[0] + row[1] + row[2] == Approx(1).epsilon(1e-12));
  }
}

TEST_CASE("clipped patches are named and left out") {
  const Rendering rendering = render(kTilted, kCamera, 1.15, 0, 5);
  const ChartReading reading = read_chart(rendering.picture, 1, kTilted);
  CHECK_FALSE(reading.patches[18].used);
  CHECK_THAT(reading.patches[18].reason, Catch::Matchers::Contains("clipped"));
  const ColourFit fit = fit_colour(reading);
  CHECK(fit.used >= 20);
  CHECK(fit.mean_delta_e < 0.5);
  CHECK(largest_off(fit, kCamera, 1.15) < 1);
}

TEST_CASE("pictures without a chart, or with one that says too little, are refused") {
  core::Image grey(200, 300, 3);
  for (float& v : grey.values()) v = 0.4F;
  CHECK_THROWS_AS(read_chart(grey), core::BadInput);
  CHECK_THROWS_AS(read_chart(grey, 0, kTilted), core::BadInput);
  CHECK_THROWS_AS(read_chart(core::Image(200, 300, 3)), core::BadInput);
  CHECK_THROWS_AS(read_chart(core::Image(200, 300, 1)), core::BadInput);
  grey(3, 4, 1) = std::numeric_limits<float>::quiet_NaN();
  CHECK_THROWS_AS(read_chart(grey), core::BadInput);
  const Rendering bright = render(kTilted, kCamera, 6, 0, 5);
  CHECK_THROWS_AS(fit_colour(read_chart(bright.picture, 1, kTilted)), core::BadInput);
}

}  // namespace lightstage::calib
