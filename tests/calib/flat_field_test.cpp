#include "calib/flat_field.h"

#include <catch2/catch.hpp>
#include <cmath>
#include <limits>

#include "core/error.h"
#include "sim/sensor.h"

namespace lightstage::calib {

namespace {

constexpr double kVignetting = 0.15;
constexpr core::Nanoseconds kExposure = 10 * core::kMillisecond;

double true_flat(core::ImageSize size, int y, int x) {
  const double dy = 2 * y + 1 - size.height, dx = 2 * x + 1 - size.width;
  return 1 - kVignetting * (dy * dy + dx * dx) / (size.height * size.height + size.width * size.width);
}

// A card of radiance 0.6 of full scale, brighter towards one side, through the simulated sensor.
core::Image card(core::ImageSize size, double gx, double gy, std::uint64_t seed, double level = 0.6) {
  core::Image radiance(size);
  const double scale = sim::saturation_radiance(1, kExposure);
  constexpr double kColour[] = {1, 0.8, 0.5};
  for (int y = 0; y < size.height; ++y) {
    for (int x = 0; x < size.width; ++x) {
      const double gradient = std::exp(gx * (2.0 * x / size.width - 1) + gy * (2.0 * y / size.height - 1));
      for (int c = 0; c < size.channels; ++c) radiance(y, x, c) = float(level * scale * gradient * kColour[c]);
    }
  }
  sim::SensorSpec sensor;
  sensor.vignetting = kVignetting;
  return sim::sense(radiance, sensor, 1, kExposure, seed);
}

double largest_error(const FlatField& field) {
  double largest = 0;
  const core::ImageSize size = field.flat.size();
  for (int y = 0; y < size.height; ++y) {
    for (int x = 0; x < size.width; ++x) {
      for (int c = 0; c < size.channels; ++c) {
        largest = std::max(largest, std::abs(double(field.flat(y, x, c)) / true_flat(size, y, x) - 1));
      }
    }
  }
  return largest;
}

}  // namespace

TEST_CASE("a card under a gradient of light gives the lens's vignetting to 0.5 %") {
  for (const core::ImageSize size : {core::ImageSize{256, 256, 3}, {240, 320, 1}, {97, 401, 3}}) {
    const core::Image picture = card(size, 0.1, -0.05, 3);
    const FlatField field = fit_flat_field(std::vector<FlatPicture>{{picture, sim::saturation_radiance(1, kExposure)}});
    INFO(size.width << " x " << size.height << ": error " << largest_error(field) << ", promised " << field.sigma
                    << ", condition " << field.condition);
    CHECK(largest_error(field) < 0.005);
    CHECK(field.sigma > 0);
    CHECK(field.sigma < 0.003);
    CHECK(field.condition < 20);
    CHECK(field.corner.front() == Approx(1 - kVignetting).margin(0.005));
    REQUIRE(field.gradients.size() == 1);
    CHECK(field.gradients[0][0] == Approx(std::expm1(0.1)).margin(0.003));
    CHECK(field.gradients[0][1] == Approx(std::expm1(-0.05)).margin(0.003));
  }
}

TEST_CASE("the flat field's standard errors are as large as its errors") {
  const core::ImageSize size{192, 192, 1};
  double squares = 0;
  int n = 0;
  for (std::uint64_t seed = 1; seed <= 40; ++seed) {
    // Alone and in pairs; corners, where errors are largest.
    const core::Image first = card(size, 0.03, 0, seed), second = card(size, -0.03, 0.02, 100 + seed);
    std::vector<FlatPicture> pictures{{first}};
    if (seed % 2 == 0) pictures.push_back({second});
    const FlatField field = fit_flat_field(pictures);
    squares += std::pow((field.corner[0] / (1 - kVignetting) - 1) / field.sigma, 2);
    ++n;
  }
  const double ratio = std::sqrt(squares / n);
  CHECK(ratio > 0.75);  // of 40 draws
  CHECK(ratio < 1.3);
}

TEST_CASE("dust, a clipped lamp and a finger in the corner do not enter the flat field") {
  const core::ImageSize size{256, 256, 3};
  core::Image picture = card(size, 0, 0.05, 5);
  for (int y = 0; y < 256; ++y) {
    for (int x = 0; x < 256; ++x) {
      const bool dust = std::hypot(y - 60, x - 90) < 3 || std::hypot(y - 200, x - 130) < 9;
      const bool finger = y > 220 && x < 30;
      for (int c = 0; c < 3; ++c) {
        if (dust) picture(y, x, c) *= 0.8F;
        if (finger) picture(y, x, c) *= 0.3F;
        if (std::hypot(y - 100, x - 200) < 6) picture(y, x, c) = 100;
      }
    }
  }
  const FlatField field = fit_flat_field(std::vector<FlatPicture>{{picture, 100}});
  CHECK(largest_error(field) < 0.005);
  CHECK(field.rejected > 0.01);
  CHECK(field.rejected < 0.1);
}

TEST_CASE("what all pictures share beyond the radial fit is in the smooth residual") {
  const core::ImageSize size{256, 256, 1};
  std::vector<core::Image> pictures;
  for (std::uint64_t i = 0; i < 3; ++i) {
    core::Image picture = card(size, 0.05 * double(i) - 0.05, 0.02, 20 + i);
    for (int y = 0; y < 256; ++y) {
      for (int x = 0; x < 256; ++x) picture(y, x) *= float(1 + 0.02 * std::sin(x * 2 * M_PI / 200 + 1));
    }
    pictures.push_back(std::move(picture));
  }
  const std::vector<FlatPicture> views{{pictures[0]}, {pictures[1]}, {pictures[2]}};
  const auto off =
      [&](const FlatField&
              field) {  // root of the mean square, any factor and plane aside: x - 128 cancels in pairs of columns
        double sum = 0, squares = 0;
        for (int y = 16; y < 240; ++y) {
          for (int x = 16; x < 240; ++x) {
            const double e = std::log(double(field.flat(y, x)) /
                                      (true_flat(size, y, x) * (1 + 0.02 * std::sin(x * 2 * M_PI / 200 + 1))));
            sum += e;
            squares += e * e;
          }
        }
        const double n = 224.0 * 224.0;
        return std::sqrt(squares / n - sum / n * sum / n);
      };
  const double without = off(fit_flat_field(views)), with = off(fit_flat_field(views, {.smooth_residual = true}));
  CHECK(without > 0.01);
  CHECK(with < 0.6 * without);  // what is left of it is a plane, which may as well be the light's
}

TEST_CASE("known illumination is taken out of the flat field") {
  const core::ImageSize size{200, 200, 1};
  core::Image picture = card(size, 0, 0, 9);
  const auto light = [](double x, double y) { return 1 / (1 + (std::pow(x - 99.5, 2) + std::pow(y - 99.5, 2)) / 3e5); };
  for (int y = 0; y < 200; ++y) {
    for (int x = 0; x < 200; ++x) picture(y, x) *= float(light(x, y));
  }
  CHECK(largest_error(fit_flat_field(std::vector<FlatPicture>{{picture}})) > 0.03);
  CHECK(largest_error(fit_flat_field(std::vector<FlatPicture>{{picture, 0, light}})) < 0.005);
}

TEST_CASE("pictures that say nothing of the lens are refused") {
  const core::ImageSize size{64, 64, 1};
  const auto refuses = [](const std::vector<FlatPicture>& pictures, const std::string& what, FlatOptions options = {}) {
    try {
      fit_flat_field(pictures, options);
      FAIL("nothing was thrown");
    } catch (const core::BadInput& error) {
      CHECK_THAT(error.what(), Catch::Matchers::Contains(what));
    }
  };
  const core::Image good = card(size, 0, 0, 1), small(8, 8, 1), black(64, 64, 1), other(64, 65, 1);
  core::Image white(64, 64, 1), broken = good;
  for (float& v : white.values()) v = 1;
  broken(1, 2) = std::numeric_limits<float>::infinity();
  refuses({}, "no pictures");
  refuses({{small}}, "32 pixels");
  refuses({{good}, {other}}, "picture 1 is of another size");
  refuses({{good}, {broken}}, "picture 1");
  refuses({{black}}, "picture 0 is clipped or too dark");
  refuses({{good}, {white, 1}}, "picture 1 is clipped or too dark");
  refuses({{good}}, "degree", {.degree = 6});
  // Even to the last bit: no scatter, and no loss.
  CHECK(fit_flat_field(std::vector<FlatPicture>{{white}}).corner.front() == Approx(1).epsilon(1e-9));
}

}  // namespace lightstage::calib
