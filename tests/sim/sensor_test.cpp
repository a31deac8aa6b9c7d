#include "sim/sensor.h"

#include <catch2/catch.hpp>
#include <limits>
#include <set>

#include "core/error.h"
#include "core/parallel.h"
#include "sim/devices/poisson.h"

using namespace lightstage;
using sim::SensorSpec;

namespace {

constexpr double kResponsivity = 45;
constexpr core::Nanoseconds kExposure = 20 * core::kMillisecond;
constexpr double kSaturation = 1 / (45 * 0.020);

core::Image flat(int height, int width, int channels, float value) {
  core::Image image(height, width, channels);
  std::fill(image.values().begin(), image.values().end(), value);
  return image;
}

struct Moments {
  double mean = 0, variance = 0;
};
template <class Values>
Moments moments(const Values& values) {
  double sum = 0, squares = 0;
  for (const auto v : values) sum += static_cast<double>(v);
  const double n = static_cast<double>(std::size(values)), mean = sum / n;
  for (const auto v : values) squares += (static_cast<double>(v) - mean) * (static_cast<double>(v) - mean);
  return {mean, squares / (n - 1)};
}

core::Image sense(const core::Image& radiance, const SensorSpec& spec, std::uint64_t seed = 1) {
  return sim::sense(radiance, spec, kResponsivity, kExposure, seed);
}

}  // namespace

TEST_CASE("Poisson counts have the mean and variance of their law on both sides of the approximation") {
  const double mean = GENERATE(0.0, 0.01, 0.7, 5.0, 29.9, 30.1, 100.0, 1e4);
  constexpr std::size_t n = 200000;
  std::vector<double> counts(n);
  for (std::size_t i = 0; i < n; ++i) counts[i] = sim::poisson(mean, 77, i);
  const Moments found = moments(counts);
  CAPTURE(mean);
  CHECK(found.mean == Approx(mean).margin(5 * std::sqrt(mean / n)));
  CHECK(found.variance == Approx(mean).epsilon(0.02));
  // The third central moment of a Poisson count is its mean, too.
  double third = 0;
  for (const double c : counts) third += std::pow(c - found.mean, 3);
  CHECK(third / n == Approx(mean).margin(5 * std::sqrt(15 * mean * mean * mean / n + mean / n)));
}

TEST_CASE("noise of a flat picture has the variance of shot noise, read noise and quantisation together") {
  const double electrons = GENERATE(0.0, 4.0, 28.0, 40.0, 1000.0, 9000.0);
  const int bits = GENERATE(8, 12, 16);
  SensorSpec spec;
  spec.full_well_electrons = 12000;
  spec.read_noise_electrons = 6;
  spec.vignetting = 0;
  spec.bits = bits;
  const auto radiance = static_cast<float>(electrons / spec.full_well_electrons * kSaturation);
  const core::Image image = sense(flat(256, 256, 3, radiance), spec);
  const Moments found = moments(image.values());

  const double codes = std::exp2(bits) - 1 - std::exp2(bits) / 64;
  const double noise = (electrons + 36) / (12000.0 * 12000.0);
  const double step = 1 / codes;
  CAPTURE(electrons, bits);
  const double n = static_cast<double>(image.values().size());
  // At 8 bits a step is 48 electrons, eight times the read noise: the uniform model of the rounding error does not
  // hold near black.
  if (std::sqrt(noise) > 0.5 * step) {
    CHECK(found.mean / kSaturation == Approx(electrons / 12000).margin(5 * std::sqrt(noise / n) + 1e-3 * step));
    CHECK(found.variance / (kSaturation * kSaturation) == Approx(noise + step * step / 12).epsilon(0.03));
  } else {
    CHECK(std::abs(found.mean / kSaturation - electrons / 12000) <= step / 2);
  }
}

TEST_CASE("values are whole steps of the converter") {
  SensorSpec spec;
  spec.vignetting = 0;
  spec.bits = 6;
  core::Image ramp(1, 500, 1);
  for (int x = 0; x < 500; ++x) ramp(0, x) = static_cast<float>(x) / 500 * 1.2f;
  std::set<double> codes;
  const core::Image seen = sense(ramp, spec);
  for (const float v : seen.values()) {
    const double code = static_cast<double>(v) / kSaturation * 62 + 1;  // black level 1 of 63
    REQUIRE(code == Approx(std::round(code)).margin(1e-4));
    codes.insert(std::round(code));
  }
  CHECK(*codes.rbegin() == 63);
  CHECK(*codes.begin() >= 0);
  CHECK(codes.size() > 55);
}

TEST_CASE("black stays black on average, with noise on both sides of it") {
  const core::Image image = sense(flat(200, 200, 1, 0), {});
  const Moments found = moments(image.values());
  CHECK(std::abs(found.mean) < 5 * std::sqrt(found.variance / 40000));
  CHECK(*std::min_element(image.values().begin(), image.values().end()) < 0);
}

TEST_CASE("the sensor clips at its saturation, whatever comes") {
  const bool noise = GENERATE(false, true);
  SensorSpec spec;
  spec.vignetting = 0;
  spec.noise = noise;
  for (const float radiance : {2.0f, 1e5f, std::numeric_limits<float>::max(), std::numeric_limits<float>::infinity()}) {
    const core::Image seen = sense(flat(7, 5, 3, radiance), spec);
    for (const float v : seen.values()) {
      REQUIRE(v == static_cast<float>(sim::saturation_radiance(kResponsivity, kExposure)));
    }
  }
  const core::Image negative = sense(flat(3, 3, 3, -1), spec);
  for (const float v : negative.values()) REQUIRE(std::abs(v) < 0.01f);
  CHECK(sim::saturation_radiance(kResponsivity, kExposure) == Approx(1 / 0.9));
}

TEST_CASE("without noise the sensor reports the radiance itself, less vignetting") {
  SensorSpec spec;
  spec.noise = false;
  spec.vignetting = 0.15;
  const core::Image image = sense(flat(101, 101, 3, 0.5f), spec);
  CHECK(image(50, 50, 1) == Approx(0.5).epsilon(1e-6));
  // The corner pixel's centre is 100/101 of the way to the corner.
  CHECK(image(0, 0, 0) == Approx(0.5 * (1 - 0.15 * std::pow(100.0 / 101, 2))).epsilon(1e-6));
  CHECK(image(0, 50, 0) == Approx(0.5 * (1 - 0.075 * std::pow(100.0 / 101, 2))).epsilon(1e-6));
  CHECK(image(100, 100, 2) == image(0, 0, 0));
  spec.vignetting = 0;
  CHECK(sense(flat(1, 1, 3, 0.25f), spec)(0, 0, 2) == Approx(0.25).epsilon(1e-6));
}

TEST_CASE("exposure changes noise and clipping, not the mean") {
  SensorSpec spec;
  spec.vignetting = 0;
  const core::Image scene = flat(128, 128, 1, 0.1f);
  const Moments is_long = moments(sim::sense(scene, spec, kResponsivity, kExposure, 1).values());
  const Moments is_short = moments(sim::sense(scene, spec, kResponsivity, kExposure / 20, 2).values());
  CHECK(is_long.mean == Approx(0.1).epsilon(0.002));
  CHECK(is_short.mean == Approx(0.1).epsilon(0.01));
  CHECK(is_short.variance > 20 * is_long.variance);
}

TEST_CASE("a Bayer sensor reproduces flat and linearly changing colour") {
  SensorSpec spec;
  spec.noise = false;
  spec.vignetting = 0;
  spec.bayer = true;
  const int height = GENERATE(2, 3, 8, 13), width = GENERATE(2, 5, 16);
  core::Image ramp(height, width, 3), colour(height, width, 3);
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      for (int c = 0; c < 3; ++c) {
        ramp(y, x, c) = 0.1f + 0.01f * static_cast<float>(x * (c + 1)) + 0.007f * static_cast<float>(y * (3 - c));
        colour(y, x, c) = 0.2f * static_cast<float>(c + 1);
      }
    }
  }
  const core::Image seen_colour = sense(colour, spec), seen_ramp = sense(ramp, spec);
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      for (int c = 0; c < 3; ++c) {
        CAPTURE(y, x, c);
        REQUIRE(seen_colour(y, x, c) == Approx(colour(y, x, c)).epsilon(1e-5));
        const bool inside = y > 0 && x > 0 && y < height - 1 && x < width - 1;
        if (inside) REQUIRE(seen_ramp(y, x, c) == Approx(ramp(y, x, c)).epsilon(1e-5));
      }
    }
  }
}

TEST_CASE("a Bayer sensor measures R at the first pixel and B at the one diagonally next") {
  SensorSpec spec;
  spec.noise = false;
  spec.vignetting = 0;
  spec.bayer = true;
  core::Image dot(4, 4, 3);
  dot(0, 0, 0) = 0.5f;
  dot(0, 0, 1) = dot(0, 0, 2) = 0.25f;  // not measured there
  dot(1, 1, 2) = 0.75f;
  dot(1, 1, 0) = dot(1, 1, 1) = 0.25f;
  const core::Image seen = sense(dot, spec);
  CHECK(seen(0, 0, 0) == Approx(0.5));
  CHECK(seen(1, 1, 2) == Approx(0.75));
  for (const float green : {seen(0, 0, 1), seen(1, 1, 1), seen(0, 1, 1), seen(1, 0, 1)}) CHECK(green == 0);
  // One pixel alone has no other colour: its own value stands for all.
  const core::Image one = sense(flat(1, 1, 3, 0.5f), spec);
  CHECK((one(0, 0, 1) == one(0, 0, 0) && one(0, 0, 2) == one(0, 0, 0)));
}

TEST_CASE("noise is the seed's, not the thread count's") {
  const core::Image scene = flat(67, 31, 3, 0.3f);
  SensorSpec spec;
  spec.bayer = GENERATE(false, true);
  core::set_thread_count(1);
  const core::Image one = sense(scene, spec, 5);
  core::set_thread_count(3);
  const core::Image three = sense(scene, spec, 5);
  core::set_thread_count(0);
  CHECK(one == three);
  CHECK_FALSE(sense(scene, spec, 6) == one);
}

TEST_CASE("noise of neighbouring values is independent") {
  SensorSpec spec;
  spec.vignetting = 0;
  const core::Image image = sense(flat(256, 256, 3, 0.5f), spec);
  const std::span<const float> v = image.values();
  const Moments m = moments(v);
  for (const std::size_t lag : {1u, 2u, 3u, 768u}) {
    double covariance = 0;
    for (std::size_t i = 0; i + lag < v.size(); ++i) {
      covariance += (static_cast<double>(v[i]) - m.mean) * (static_cast<double>(v[i + lag]) - m.mean);
    }
    const double n = static_cast<double>(v.size() - lag);
    CHECK(std::abs(covariance / n / m.variance) < 5 / std::sqrt(n));
  }
}

TEST_CASE("sensors that cannot be are refused") {
  const auto refused = [](auto change, int channels = 3) {
    SensorSpec spec;
    change(spec);
    CHECK_THROWS_AS(sense(flat(2, 2, channels, 0), spec), core::BadInput);
  };
  refused([](SensorSpec& s) { s.bits = 0; });
  refused([](SensorSpec& s) { s.bits = 25; });
  refused([](SensorSpec& s) { s.full_well_electrons = 0; });
  refused([](SensorSpec& s) { s.read_noise_electrons = -1; });
  refused([](SensorSpec& s) { s.vignetting = 1.1; });
  refused([](SensorSpec&) {}, 2);
  refused([](SensorSpec& s) { s.bayer = true; }, 1);
  CHECK_THROWS_AS(sim::sense(flat(2, 2, 3, 0), {}, kResponsivity, 0, 1), core::BadInput);
  CHECK_THROWS_AS(sim::sense(flat(2, 2, 3, 0), {}, 0, kExposure, 1), core::BadInput);
}
