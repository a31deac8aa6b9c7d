// Merged exposures, response and linearity from stacks of exposures of one scene.
#include <catch2/catch.hpp>
#include <cmath>
#include <limits>
#include <random>

#include "calib/linearity.h"
#include "calib/response.h"
#include "core/display.h"
#include "core/error.h"
#include "core/exposure_merge.h"
#include "sim/sensor.h"

namespace lightstage::calib {

namespace {

// Bright and dark parts over three decades, smooth.
core::Image scene(int height, int width, int channels) {
  core::Image image(height, width, channels);
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      const double level = std::pow(10, 1.5 * (std::sin(x * 0.05) + std::cos(y * 0.04)) / 2);
      for (int c = 0; c < channels; ++c) image(y, x, c) = float(level * (1 - 0.2 * c));
    }
  }
  return image;
}

struct Stack {
  std::vector<core::Image> pictures;
  std::vector<double> seconds;
  std::vector<ExposedPicture> views() const {
    std::vector<ExposedPicture> result;
    for (std::size_t i = 0; i < pictures.size(); ++i) result.push_back({pictures[i], seconds[i]});
    return result;
  }
};

// Values of the simulated 12-bit sensor as shares of its range, through `bend` and above `black`; two pictures of every exposure.
template <class Bend>
Stack linear_stack(double black, const Bend& bend) {
  Stack stack;
  const core::Image radiance = scene(160, 192, 1);
  sim::SensorSpec sensor;
  sensor.vignetting = 0;
  std::uint64_t seed = 1;
  for (const double ms : {2.0, 5.0, 10.0, 20.0, 40.0}) {
    for (int twice = 0; twice < 2; ++twice) {
      const auto exposure = core::Nanoseconds(ms * core::kMillisecond);
      core::Image picture = sim::sense(radiance, sensor, 4, exposure, seed++);
      const double saturation = sim::saturation_radiance(4, exposure);
      for (float& v : picture.values()) v = float(black + bend(double(v) / saturation) * (1 - black));
      stack.pictures.push_back(std::move(picture));
      stack.seconds.push_back(ms / 1000);
    }
  }
  return stack;
}

}  // namespace

TEST_CASE("merged exposures of the 12-bit sensor are linear to 0.5 % over 14 stops") {
  constexpr int kSteps = 14 * 4 + 1, kPixels = 20000;
  constexpr core::Nanoseconds kShortest = core::kMillisecond;
  sim::SensorSpec sensor;
  sensor.vignetting = 0;
  core::Image truth(kSteps, kPixels, 1);
  for (int y = 0; y < kSteps; ++y) {
    const double level = 0.78 * sim::saturation_radiance(1, kShortest) * std::exp2(-0.25 * y);
    for (int x = 0; x < kPixels; ++x) truth(y, x) = float(level);
  }
  std::vector<core::Image> images;
  std::vector<core::Exposure> exposures;
  for (int i = 0; i < 5; ++i) images.push_back(sim::sense(truth, sensor, 1, kShortest << (2 * i), std::uint64_t(i)));
  for (int i = 0; i < 5; ++i) {
    const core::Nanoseconds time = kShortest << (2 * i);
    exposures.push_back({images[std::size_t(i)], double(time) / core::kSecond, sim::saturation_radiance(1, time), {}});
  }
  const core::MergedExposures merged = core::merge_exposures(exposures);
  CHECK(merged.saturated_values == 0);
  double largest = 0;
  for (int y = 0; y < kSteps; ++y) {
    double sum = 0;
    for (int x = 0; x < kPixels; ++x) sum += double(merged.image(y, x)) / double(truth(y, x));
    largest = std::max(largest, std::abs(sum / kPixels - 1));
  }
  CHECK(largest < 0.003);
}

TEST_CASE("a linear sensor is found linear, with its black level, its clipping, its electrons and its read noise") {
  for (const double black : {0.0, 1.0 / 64}) {
    const Stack stack = linear_stack(black, [](double v) { return v; });
    const LinearityReport report = check_linearity(stack.views());
    INFO(report.verdict);
    CHECK(report.linear);
    CHECK(report.largest_deviation < 0.003);
    CHECK(report.black_level == Approx(black).margin(5e-4));
    REQUIRE(report.clips_at);
    CHECK(*report.clips_at == Approx(1).epsilon(1e-4));
    REQUIRE(report.electrons_per_unit);
    CHECK(*report.full_well_electrons == Approx(10500).epsilon(0.03));
    REQUIRE(report.read_noise_electrons);
    CHECK(*report.read_noise_electrons == Approx(2.6).margin(0.7));  // quantisation adds 0.75 electrons
    CHECK(report.exposures.size() == 10);
  }
}

TEST_CASE("a sensor that bends is found out") {
  const Stack stack = linear_stack(0, [](double v) { return v - 0.06 * v * v; });
  const LinearityReport report = check_linearity(stack.views());
  INFO(report.verdict);
  CHECK_FALSE(report.linear);
  CHECK(report.largest_deviation > 0.015);
  const Stack encoded = linear_stack(0, [](double v) { return std::pow(std::max(v, 0.0), 1 / 2.2); });
  CHECK_FALSE(check_linearity(encoded.views()).linear);
}

TEST_CASE("an exposure of another time than was said stands out alone") {
  Stack stack = linear_stack(0, [](double v) { return v; });
  for (const std::size_t i : {4, 5}) {
    for (float& v : stack.pictures[i].values()) v = std::min(v * 1.05F, 1.0F);
  }
  const LinearityReport report = check_linearity(stack.views());
  CHECK(report.exposures[4].deviation > 0.025);
  for (const std::size_t i : {0, 1, 2, 3, 6, 7, 8, 9}) CHECK(std::abs(report.exposures[i].deviation) < 0.025);
}

TEST_CASE("stacks that say nothing are refused") {
  const core::Image a = scene(64, 64, 1), small = scene(32, 32, 1);
  core::Image white(64, 64, 1), broken = a;
  for (float& v : white.values()) v = 1;
  broken(0, 0) = std::numeric_limits<float>::quiet_NaN();
  CHECK_THROWS_AS(check_linearity(std::vector<ExposedPicture>{{a, 1}, {a, 2}}), core::BadInput);
  CHECK_THROWS_AS(check_linearity(std::vector<ExposedPicture>{{a, 1}, {a, 2}, {small, 3}}), core::BadInput);
  CHECK_THROWS_AS(check_linearity(std::vector<ExposedPicture>{{a, 1}, {a, 2}, {a, 0}}), core::BadInput);
  CHECK_THROWS_AS(check_linearity(std::vector<ExposedPicture>{{a, 1}, {a, 2}, {broken, 3}}), core::BadInput);
  CHECK_THROWS_AS(check_linearity(std::vector<ExposedPicture>{{white, 1}, {white, 2}, {white, 3}}), core::BadInput);
  CHECK_THROWS_AS(estimate_response(std::vector<ExposedPicture>{{white, 1}, {white, 2}}), core::BadInput);
  CHECK_THROWS_AS(estimate_response(std::vector<ExposedPicture>{{white, 1}, {white, 1}}), core::BadInput);
  CHECK_THROWS_AS(estimate_response(std::vector<ExposedPicture>{{a, 1}, {a, 2}}), core::BadInput);  // above 1
}

TEST_CASE("the response of an sRGB camera is recovered from eight bits") {
  Stack stack;
  const core::Image radiance = scene(120, 160, 3);
  sim::SensorSpec sensor;
  sensor.vignetting = 0;
  std::uint64_t seed = 1;
  for (const double ms : {1.0, 2.0, 4.0, 8.0, 16.0, 32.0, 64.0}) {
    const auto exposure = core::Nanoseconds(ms * core::kMillisecond);
    core::Image picture = sim::sense(radiance, sensor, 8, exposure, seed++);
    const double saturation = sim::saturation_radiance(8, exposure);
    for (float& v : picture.values()) {
      v = std::round(core::srgb_encode(std::clamp(float(double(v) / saturation), 0.0F, 1.0F)) * 255) / 255;
    }
    stack.pictures.push_back(std::move(picture));
    stack.seconds.push_back(ms / 1000);
  }
  for (const ResponseMethod method : {ResponseMethod::kDebevec, ResponseMethod::kRobertson}) {
    const CameraResponse response = estimate_response(stack.views(), method);
    double largest = 0;
    for (std::size_t c = 0; c < 3; ++c) {
      REQUIRE(response.curve[c].size() == 256);
      CHECK(std::is_sorted(response.curve[c].begin(), response.curve[c].end()));
      const double scale = response.curve[c][128] / double(core::srgb_decode(128.0F / 255));
      for (std::size_t k = 20; k <= 255; ++k) {
        const double truth = scale * double(core::srgb_decode(float(k) / 255));
        largest = std::max(largest, std::abs(response.curve[c][k] / truth - 1));
      }
    }
    INFO(int(method) << ": largest error " << largest << ", residual " << response.residual);
    CHECK(largest < 0.04);
    CHECK(response.residual < 0.08);  // steps of eight bits, mostly
    const core::Image light = exposure_of(stack.pictures[3], response);
    CHECK(light(60, 80, 1) == Approx(response.curve[1][std::size_t(std::lround(stack.pictures[3](60, 80, 1) * 255))]));
  }
}

}  // namespace lightstage::calib
