// Spherical harmonics of maps against plain sums, and the laws that they obey.
#include <catch2/catch.hpp>
#include <numbers>
#include <random>

#include "core/error.h"
#include "core/parallel.h"
#include "relight/environment.h"
#include "relight/harmonics.h"
#include "relight/sky.h"

namespace lightstage {

namespace {

using core::Image;
using core::Vec3;
using relight::Environment;
using relight::Harmonics;

constexpr double kPi = std::numbers::pi;

Image noise(int height, int width, unsigned seed) {
  std::mt19937 random(seed);
  Image map(height, width, 3);
  for (float& value : map.values()) value = float(random() % 1000) / 1000 - 0.2f;
  return map;
}

Image constant(int height, int width, float value) {
  Image map(height, width, 3);
  std::fill(map.values().begin(), map.values().end(), value);
  return map;
}

// From the standard library's functions, which know nothing of ours (and have the Condon-Shortley phase).
double harmonic(int l, int m, double latitude, double longitude) {
  const unsigned order = unsigned(std::abs(m));
  const double legendre = (order % 2 == 0 ? 1 : -1) * std::sph_legendre(unsigned(l), order, kPi / 2 - latitude);
  if (m == 0) return legendre;
  return std::numbers::sqrt2 * legendre * (m > 0 ? std::cos(m * longitude) : std::sin(-m * longitude));
}

// The coefficient by the midpoint rule with so many points a pixel and axis: its error falls with their square.
double plain_coefficient(const Image& map, int l, int m, int points) {
  double sum = 0;
  const int rows = map.height() * points, columns = map.width() * points;
  for (int i = 0; i < rows; ++i) {
    const double latitude = kPi * (0.5 - (i + 0.5) / rows);
    for (int j = 0; j < columns; ++j) {
      const double longitude = kPi * (1 - 2 * (j + 0.5) / columns);
      sum += map(i / points, j / points, 1) * std::cos(latitude) * harmonic(l, m, latitude, longitude);
    }
  }
  return sum * kPi / rows * 2 * kPi / columns;
}

// A harmonic, in all channels, by its means over pixels (a 3x3 Gauss rule in each).
Image map_of_harmonic(int height, int width, int l, int m) {
  Image map(height, width, 3);
  constexpr double kNodes[] = {-0.7745966692414834, 0, 0.7745966692414834}, kWeights[] = {5.0 / 18, 8.0 / 18, 5.0 / 18};
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x) {
      double sum = 0, area = 0;
      for (int i = 0; i < 3; ++i)
        for (int j = 0; j < 3; ++j) {
          const double latitude = kPi * (0.5 - (y + 0.5 + kNodes[i] / 2) / height);
          const double longitude = kPi * (1 - 2 * (x + 0.5 + kNodes[j] / 2) / width);
          const double weight = kWeights[i] * kWeights[j] * std::cos(latitude);
          sum += weight * harmonic(l, m, latitude, longitude);
          area += weight;
        }
      for (int c = 0; c < 3; ++c) map(y, x, c) = float(sum / area);
    }
  return map;
}

std::vector<double> ones(int degree) {
  return std::vector<double>(std::size_t(degree) + 1, 1.0);
}

double sum_of(const std::vector<double>& values) {
  return std::accumulate(values.begin(), values.end(), 0.0);
}

double squared_integral(const Image& map) {
  double sum = 0;
  for (int y = 0; y < map.height(); ++y)
    for (int x = 0; x < map.width(); ++x)
      for (int c = 0; c < 3; ++c)
        sum += double(map(y, x, c)) * map(y, x, c) * Environment::solid_angle(y, map.height(), map.width());
  return sum;
}

}  // namespace

TEST_CASE("coefficients are those of plain sums over the areas of the pixels, for odd and tiny maps too",
          "[harmonics]") {
  for (const auto& [height, width] : {std::pair{1, 1}, {1, 2}, {2, 1}, {2, 4}, {5, 3}, {7, 13}, {8, 16}}) {
    const Image map = noise(height, width, unsigned(height * 100 + width));
    const int degree = 9;
    const Harmonics harmonics(map, degree);
    const int points = 240 / std::max(height, width) + 1;
    for (const auto& [l, m] :
         {std::pair{0, 0}, {1, -1}, {1, 0}, {1, 1}, {2, -2}, {3, 2}, {5, 0}, {7, -3}, {9, 9}, {9, -8}}) {
      CAPTURE(height, width, l, m);
      // Richardson: the midpoint rule's error is even in the step.
      const double coarse = plain_coefficient(map, l, m, points), fine = plain_coefficient(map, l, m, 2 * points);
      CHECK(harmonics.coefficient(l, m).y == Approx((4 * fine - coarse) / 3).margin(2e-7));
    }
  }
}

TEST_CASE("harmonics are orthonormal: a map of one has that coefficient and no other", "[harmonics]") {
  const int degree = 12;
  for (const auto& [l, m] : {std::pair{0, 0}, {1, 0}, {1, -1}, {4, 3}, {7, -7}, {12, 0}, {12, 11}, {12, -5}}) {
    const Harmonics harmonics(map_of_harmonic(128, 256, l, m), degree);
    for (int i = 0; i <= degree; ++i)
      for (int j = -i; j <= i; ++j) {
        CAPTURE(l, m, i, j);
        const bool same = i == l && j == m;
        // Means over pixels of h radians, taken twice, are 1 - l (l + 1) h^2 / 12 of what they are taken of.
        REQUIRE(harmonics.coefficient(i, j).z ==
                Approx(same ? 1 : 0).margin(1.05 * l * (l + 1) * std::pow(kPi / 128, 2) / 12 + 1e-6));
      }
  }
}

TEST_CASE("a constant map is degree 0 and nothing else, of any size", "[harmonics]") {
  for (const auto& [height, width] : {std::pair{1, 1}, {1, 2}, {2, 1}, {3, 7}, {64, 128}, {101, 211}}) {
    const std::vector<double> energy = Harmonics(constant(height, width, 0.75f), 60).energy_by_degree();
    CHECK(energy[0] == Approx(3 * 4 * kPi * 0.75 * 0.75).epsilon(1e-13));
    for (std::size_t l = 1; l < energy.size(); ++l) REQUIRE(energy[l] < 1e-26);
  }
  for (const double energy : Harmonics(Image(8, 16, 3), 50).energy_by_degree()) CHECK(energy == 0);
}

TEST_CASE("the energy of a one-pixel sun grows with 2 l + 1, wherever it stands", "[harmonics]") {
  const int height = 512, width = 1024;
  for (const auto& [y, x] : {std::pair{0, 0}, {0, 511}, {1, 1023}, {255, 512}, {300, 0}, {511, 77}}) {
    CAPTURE(y, x);
    Image map(height, width, 3);
    map(y, x, 0) = 1e6f;
    const double light = 1e6 * Environment::solid_angle(y, height, width);
    const std::vector<double> energy = Harmonics(map, 50).energy_by_degree();
    for (std::size_t l = 0; l < energy.size(); ++l) {
      CAPTURE(l);
      // At a pole a pixel is a thin wedge; all are smaller than the finest of these harmonics.
      REQUIRE(energy[l] == Approx(light * light * double(2 * l + 1) / (4 * kPi)).epsilon(0.011));
    }
  }
}

TEST_CASE("a sun's coefficients are the harmonics where it stands, to high degrees", "[harmonics]") {
  const int height = 512, width = 1024, degree = 200;
  for (const auto& [y, x] : {std::pair{2, 100}, {150, 750}, {255, 512}}) {
    Image map(height, width, 3);
    map(y, x, 1) = 1;
    const Environment environment(map);
    const Harmonics harmonics(map, degree);
    const double latitude = kPi * (0.5 - (y + 0.5) / height), longitude = kPi * (1 - 2 * (x + 0.5) / width);
    for (const auto& [l, m] : {std::pair{100, 0}, {100, 100}, {130, -3}, {200, 1}, {200, -100}, {200, 199}}) {
      CAPTURE(y, x, l, m);
      const double scale = std::sqrt((2 * l + 1) / (4 * kPi));
      CHECK(harmonics.coefficient(l, m).y / environment.solid_angle(y) ==
            Approx(harmonic(l, m, latitude, longitude)).margin(0.1 * scale));
    }
    for (const double energy : harmonics.energy_by_degree()) REQUIRE(std::isfinite(energy));
  }
}

TEST_CASE("turning a map about the vertical turns pairs of coefficients and leaves energies alone", "[harmonics]") {
  const int width = 90, degree = 30;
  Image sun = noise(45, width, 3);
  sun(11, 5, 0) = 1e6f;
  const Environment map(sun);
  const Harmonics before(map.radiance(), degree);
  for (const int pixels : {1, 17, -40}) {
    const double degrees = 360.0 * pixels / width;
    const Harmonics after(map.rotated(degrees).radiance(), degree);
    const std::vector<double> a = before.energy_by_degree(), b = after.energy_by_degree();
    for (int l = 0; l <= degree; ++l) {
      REQUIRE(b[std::size_t(l)] == Approx(a[std::size_t(l)]).epsilon(1e-12));
      const double scale = std::sqrt(a[std::size_t(l)]);
      for (int m = 0; m <= l; ++m) {
        const double turn = m * degrees * kPi / 180;
        const Vec3 cosine = before.coefficient(l, m), sine = m == 0 ? Vec3{} : before.coefficient(l, -m);
        const Vec3 expected = std::cos(turn) * cosine - std::sin(turn) * sine;
        REQUIRE(core::norm(after.coefficient(l, m) - expected) < 1e-12 * scale);
      }
    }
  }
}

TEST_CASE("all degrees together hold the squared map, and never more (Parseval)", "[harmonics]") {
  const auto smooth =
      relight::filtered(relight::clear_sky({.height = 64, .sun_to_sky = 1}).radiance(), relight::cutoff_weights(4, 12));
  CHECK(sum_of(Harmonics(smooth, 150).energy_by_degree()) == Approx(squared_integral(smooth)).epsilon(3e-3));
  for (const auto& [height, width] : {std::pair{1, 1}, {2, 4}, {9, 20}}) {
    const Image map = noise(height, width, 5);
    const double all = squared_integral(map);
    double before = 0;
    for (const int degree : {5, 50, 300}) {
      const double held = sum_of(Harmonics(map, degree).energy_by_degree());
      CHECK(held <= all * (1 + 1e-12));
      CHECK(held >= before * (1 - 1e-12));
      before = held;
    }
    CHECK(before > 0.95 * all);
  }
}

TEST_CASE("maps without fine degrees come back, the better the finer their pixels; light is kept exactly",
          "[harmonics]") {
  const Image rough = noise(20, 40, 9);
  double error_before = 0;
  for (const int height : {32, 64, 128}) {
    const std::vector<double> weights = relight::cutoff_weights(3, 9);
    const Image band_limited = Harmonics(rough, 8).map(height, 2 * height, weights);
    const Image again = Harmonics(band_limited, 8).map(height, 2 * height, ones(8));
    double error = 0;
    for (std::size_t i = 0; i < again.values().size(); ++i)
      error = std::max(error, double(std::abs(again.values()[i] - band_limited.values()[i])));
    if (error_before > 0) CHECK(error == Approx(error_before / 4).epsilon(0.1));  // second order
    error_before = error;
    const Vec3 light = Harmonics(rough, 0).coefficient(0, 0), kept = Harmonics(band_limited, 0).coefficient(0, 0);
    CHECK(core::norm(light - kept) < 1e-7 * core::norm(light));
  }
  CHECK(error_before < 1e-3);
  // Pixel means of what is known: also where there are more degrees than pixels.
  for (const auto& [height, width] : {std::pair{1, 1}, {1, 2}, {2, 1}, {3, 5}}) {
    const Harmonics harmonics(rough, 30);
    const Image small = harmonics.map(height, width, ones(30));
    const Image large = harmonics.map(height * 60, width * 60, ones(30));
    const Environment positive(constant(1, 1, 1));
    for (int y = 0; y < height; ++y)
      for (int x = 0; x < width; ++x) {
        double sum = 0, area = 0;
        for (int i = 0; i < 60; ++i)
          for (int j = 0; j < 60; ++j) {
            const double weight = Environment::solid_angle(60 * y + i, 60 * height, 60 * width);
            sum += weight * large(60 * y + i, 60 * x + j, 2);
            area += weight;
          }
        CHECK(small(y, x, 2) == Approx(sum / area).margin(1e-6));
      }
  }
}

TEST_CASE("a cut-off keeps what lies below and takes what lies above", "[harmonics]") {
  const Image rough = noise(128, 256, 2);
  const std::vector<double> before = Harmonics(rough, 40).energy_by_degree();
  const std::vector<double> weights = relight::cutoff_weights(10, 20);
  REQUIRE(weights.size() == 20);
  CHECK(weights[10] == 1);
  CHECK(weights[15] == Approx(0.5));
  CHECK(weights[19] < 0.03);
  const std::vector<double> after = Harmonics(relight::filtered(rough, weights), 40).energy_by_degree();
  for (std::size_t l = 0; l < 40; ++l) {
    CAPTURE(l);
    const double expected = l < weights.size() ? weights[l] * weights[l] * before[l] : 0;
    const double pixels_blur = double(l * (l + 1)) * std::pow(kPi / 128, 2) / 6;  // drawn once, read once, squared
    CHECK(after[l] == Approx(expected).epsilon(1.1 * pixels_blur + 0.01).margin(1e-5 * before[l]));
  }
  CHECK_THROWS_AS(relight::cutoff_weights(-1, 5), core::UsageError);
  CHECK_THROWS_AS(relight::cutoff_weights(5, 5), core::UsageError);
  CHECK_THROWS_AS(relight::filtered(rough, {}), core::UsageError);
  CHECK_THROWS_AS(Harmonics(rough, 5).map(8, 16, ones(4)), core::UsageError);
  CHECK_THROWS_AS(Harmonics(rough, 5).map(0, 16, ones(5)), core::UsageError);
}

TEST_CASE("a blurred sun is a round Gaussian that nowhere takes light away", "[harmonics]") {
  Image map(64, 128, 3);
  map(10, 127, 1) = 1e6f;
  const double sigma = 0.2;
  const Image blurred = relight::filtered(map, relight::blur_weights(sigma));
  const Environment frame(map);
  const float peak = *std::max_element(blurred.values().begin(), blurred.values().end());
  CHECK(blurred(10, 127, 1) == peak);
  for (int y = 0; y < 64; ++y)
    for (int x = 0; x < 128; ++x) {
      REQUIRE(blurred(y, x, 0) == 0);
      REQUIRE(blurred(y, x, 1) > -1e-6f * peak);
      // On the plane it would be a Gaussian; the sphere's is that to second order.
      const double angle = core::angle_radians(frame.direction(y, x), frame.direction(10, 127));
      if (angle < 2 * sigma)
        REQUIRE(blurred(y, x, 1) == Approx(peak * std::exp(-angle * angle / (2 * sigma * sigma))).epsilon(0.05));
    }
  CHECK_NOTHROW(relight::blur_weights(0.0065));
  CHECK(relight::blur_weights(100).size() == 2);
  for (const double bad : {0.0, -1.0, 0.001, double(NAN), double(INFINITY)})
    CHECK_THROWS_AS(relight::blur_weights(bad), core::UsageError);
}

TEST_CASE("harmonics and their maps are bit-equal for every thread count", "[harmonics]") {
  const Image map = noise(151, 311, 4);
  core::set_thread_count(1);
  const Harmonics alone(map, 40);
  const Image drawn = alone.map(67, 131, ones(40));
  for (const int threads : {2, 3, 8}) {
    core::set_thread_count(threads);
    const Harmonics together(map, 40);
    for (int l = 0; l <= 40; ++l)
      for (int m = -l; m <= l; ++m) REQUIRE(together.coefficient(l, m) == alone.coefficient(l, m));
    CHECK(together.map(67, 131, ones(40)) == drawn);
  }
  core::set_thread_count(0);
}

TEST_CASE("harmonics take grey maps and maps with alpha, and refuse what they cannot hold", "[harmonics]") {
  Image grey(4, 8, 1), rgba(4, 8, 4);
  for (int y = 0; y < 4; ++y)
    for (int x = 0; x < 8; ++x) {
      grey(y, x) = float(x * y);
      for (int c = 0; c < 3; ++c) rgba(y, x, c) = float(x * y);
      rgba(y, x, 3) = 77;
    }
  CHECK(Harmonics(grey, 6).energy_by_degree() == Harmonics(rgba, 6).energy_by_degree());
  CHECK_THROWS_AS(Harmonics(grey, -1), core::UsageError);
  CHECK_THROWS_AS(Harmonics(grey, 1001), core::UsageError);
  CHECK_THROWS_AS(Harmonics(Image(), 5), core::BadInput);
  grey(1, 2) = NAN;
  CHECK_THROWS_WITH(Harmonics(grey, 5), Catch::Contains("x 2, y 1"));
}

TEST_CASE("harmonics of 8192 x 4096 pixels", "[harmonics]") {
  Image map(4096, 8192, 1);
  std::fill(map.values().begin(), map.values().end(), 0.5f);
  map(0, 0) = 1e6f;
  const Harmonics harmonics(map, 20);
  const double light = 4 * kPi * 0.5 + (1e6 - 0.5) * Environment::solid_angle(0, 4096, 8192);
  CHECK(harmonics.coefficient(0, 0).x == Approx(light / std::sqrt(4 * kPi)).epsilon(1e-12));
}

}  // namespace lightstage
