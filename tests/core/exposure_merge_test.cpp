#include "core/exposure_merge.h"

#include <catch2/catch.hpp>
#include <cmath>
#include <limits>
#include <random>

#include "core/error.h"
#include "core/failure.h"
#include "core/parallel.h"

using namespace lightstage;
using core::Exposure;
using core::Image;
using core::merge_exposures;

namespace {

Image row(const std::vector<float>& values, int channels = 1) {
  Image image(1, int(values.size()) / channels, channels);
  std::copy(values.begin(), values.end(), image.values().begin());
  return image;
}

// A linear sensor that clips at 1 / seconds; electrons are drawn from normal distributions.
struct Sensor {
  double full_well = 10500, read_noise = 2.5;
  std::mt19937 generator{7};

  Image expose(double radiance, double seconds, int pixels) {
    Image image(1, pixels, 1);
    const double electrons = radiance * seconds * full_well;
    std::normal_distribution<double> noise(electrons, std::sqrt(electrons + read_noise * read_noise));
    for (float& v : image.values()) v = float(std::min(noise(generator) / full_well, 1.0) / seconds);
    return image;
  }
};

double mean(const Image& image) {
  double sum = 0;
  for (const float v : image.values()) sum += double(v);
  return sum / double(image.values().size());
}
double variance(const Image& image) {
  const double m = mean(image);
  double sum = 0;
  for (const float v : image.values()) sum += (double(v) - m) * (double(v) - m);
  return sum / double(image.values().size());
}

}  // namespace

TEST_CASE("bright values are weighted by exposure time, dark ones by its square") {
  // Photons are all that counts far above the read noise, and time counts twice far below it.
  const Image a = row({0.5F, 4e-9F}), b = row({0.7F, 1e-9F});
  const std::vector<Exposure> exposures{{a, 3, 1, {}}, {b, 1, 3, {}}};
  const Image merged = merge_exposures(exposures, 0.0001).image;
  CHECK(merged(0, 0) == Approx((3 * 0.5 + 0.7) / 4).epsilon(1e-3));
  CHECK(merged(0, 1) == Approx((9 * 4e-9 + 1e-9) / 10).epsilon(1e-3));
  CHECK(merge_exposures(exposures, 0).image(0, 0) == Approx((3 * 0.5 + 0.7) / 4).epsilon(1e-6));
}

TEST_CASE("saturated values are left out, channel by channel, and marked where nothing else shows them") {
  // Long: clips at 1; short: clips at 4.
  const Image lengthy = row({1, 0.5F, 0.2F, 1, 1, 0.3F}, 3), brief = row({2, 0.7F, 0.2F, 4, 3.9F, 0.3F}, 3);
  const std::vector<Exposure> exposures{{lengthy, 4, 1, {}}, {brief, 1, 4, {}}};
  const core::MergedExposures merged = merge_exposures(exposures);
  CHECK(merged.image(0, 0, 0) == 2.0F);
  CHECK(merged.image(0, 0, 1) == Approx((4 * 0.5 + 0.7) / 5).epsilon(2e-3));
  CHECK(merged.image(0, 1, 0) == 4.0F);
  CHECK(merged.image(0, 1, 1) == 3.9F);  // too near the end of the short one's range as well
  CHECK(merged.saturated(0, 0) == 0);
  CHECK(merged.saturated(0, 1) == 1);
  CHECK(merged.saturated_values == 2);
  const Image white = row({4, 4, 4});
  CHECK(merge_exposures(std::vector<Exposure>{{white, 1, 4, {}}}).saturated_values == 3);
}

TEST_CASE("order does not matter, a repeated exposure counts twice, and one alone stays as it is") {
  const Image a = row({0.10F, -0.02F, 0.7F}), b = row({0.16F, 0.01F, 0.9F}), c = row({0.1F, 0.03F, 2});
  const std::vector<Exposure> one_way{{a, 4, 1, {}}, {b, 2, 2, {}}, {c, 1, 4, {}}};
  const std::vector<Exposure> other_way{{c, 1, 4, {}}, {a, 4, 1, {}}, {b, 2, 2, {}}};
  const Image there = merge_exposures(one_way).image, back = merge_exposures(other_way).image;
  for (std::size_t i = 0; i < 3; ++i) CHECK(there.values()[i] == Approx(back.values()[i]).epsilon(1e-6));
  const std::vector<Exposure> twice{{a, 4, 1, {}}, {a, 4, 1, {}}};
  for (std::size_t i = 0; i < 3; ++i) {
    CHECK(merge_exposures(twice).image.values()[i] == Approx(a.values()[i]).epsilon(1e-6));
  }
  CHECK(merge_exposures(std::vector<Exposure>{{a, 4, 1, {}}}).image == a);
}

TEST_CASE("a dark frame is taken off its own exposure, after what is saturated was found") {
  const Image lengthy = row({0.99F, 0.3F, 0.05F}), brief = row({1.6F, 0.5F, 0.25F});
  const Image dark_long = row({0.1F, 0.1F, 0.1F}), dark_short = row({0.3F, 0.3F, 0.3F});
  const std::vector<Exposure> exposures{{lengthy, 4, 1, dark_long}, {brief, 1, 4, dark_short}};
  const Image merged = merge_exposures(exposures).image;
  CHECK(merged(0, 0) == 1.3F);  // the long one is saturated, though less its dark frame it would not seem so
  CHECK(merged(0, 1) == Approx(0.2));
  CHECK(merged(0, 2) == Approx(-0.05));  // a dark frame brighter than the signal: negative, not cut
}

TEST_CASE("noise about black keeps its mean and its sign") {
  Sensor sensor;
  const Image a = sensor.expose(0, 1, 20000), b = sensor.expose(0, 8, 20000);
  const Image merged = merge_exposures(std::vector<Exposure>{{a, 1, 1, {}}, {b, 8, 0.125, {}}}).image;
  CHECK(std::abs(mean(merged)) < 4 * std::sqrt(variance(b) / 20000));
  CHECK(*std::min_element(merged.values().begin(), merged.values().end()) < 0);
}

TEST_CASE(
    "the weights come within 2 % of the least noise that is possible, also for a read noise wrong by four times") {
  constexpr int kPixels = 40000;
  Sensor sensor;
  const double seconds[] = {1, 4, 16};
  for (const double radiance : {3e-5, 1e-3, 0.02}) {
    std::vector<Image> images;
    std::vector<Exposure> exposures;
    double information = 0;
    for (const double t : seconds) {
      images.push_back(sensor.expose(radiance, t, kPixels));
      const double electrons = radiance * t * sensor.full_well;
      information += std::pow(t * sensor.full_well, 2) / (electrons + std::pow(sensor.read_noise, 2));
    }
    for (std::size_t i = 0; i < 3; ++i) exposures.push_back({images[i], seconds[i], 1 / seconds[i], {}});
    const double share = std::pow(sensor.read_noise, 2) / sensor.full_well;
    for (const double wrong : {0.25, 1.0, 4.0}) {
      const Image merged = merge_exposures(exposures, wrong * share).image;
      CAPTURE(radiance, wrong);
      CHECK(std::sqrt(variance(merged) * information) < 1.035);  // 1.015 of it is the sample's own scatter
      CHECK(mean(merged) == Approx(radiance).margin(4 * std::sqrt(1 / information / kPixels)).epsilon(0));
    }
  }
}

TEST_CASE("exposures of unknown saturation are weighted by time") {
  const Image a = row({1}), b = row({2});
  CHECK(merge_exposures(std::vector<Exposure>{{a, 1, 0, {}}, {b, 3, 0, {}}}).image(0, 0) == 1.75F);
}

TEST_CASE("merging does not depend on the number of threads") {
  Sensor sensor;
  Image a(50, 31, 3), b(50, 31, 3);
  for (Image* image : {&a, &b}) {
    const Image noise = sensor.expose(0.3, 1, 50 * 31 * 3);
    std::copy(noise.values().begin(), noise.values().end(), image->values().begin());
  }
  const std::vector<Exposure> exposures{{a, 1, 1, {}}, {b, 2, 0.32, {}}};
  core::set_thread_count(1);
  const core::MergedExposures alone = merge_exposures(exposures);
  core::set_thread_count(4);
  const core::MergedExposures together = merge_exposures(exposures);
  core::set_thread_count(0);
  CHECK(alone.image == together.image);
  CHECK(alone.saturated == together.saturated);
  CHECK(alone.saturated_values == together.saturated_values);
}

TEST_CASE("exposures that make no sense are refused by their place") {
  const Image a = row({1, 2}), wide = row({1, 2, 3});
  Image broken = row({1, 2});
  broken(0, 1) = std::numeric_limits<float>::quiet_NaN();
  const auto refuses = [&](std::vector<Exposure> exposures, const std::string& what) {
    try {
      merge_exposures(exposures);
      FAIL("nothing was thrown");
    } catch (const core::BadInput& error) {
      CHECK_THAT(error.what(), Catch::Matchers::Contains(what));
    }
  };
  refuses({}, "no exposures");
  refuses({{a, 1, 1, {}}, {wide, 1, 1, {}}}, "exposure 1 is of another size");
  refuses({{a, 1, 1, wide}}, "exposure 0: its dark frame");
  refuses({{a, 1, 1, {}}, {a, 0, 1, {}}}, "exposure 1: its time");
  refuses({{a, 1, -1, {}}}, "exposure 0: its saturation");
  refuses({{a, 1, 1, {}}, {broken, 1, 1, {}}}, "exposure 1");
  refuses({{a, 1, 1, broken}}, "exposure 0, dark frame");
  CHECK_THROWS_AS(merge_exposures(std::vector<Exposure>{{a, 1, 1, {}}}, -1), core::BadInput);
}
