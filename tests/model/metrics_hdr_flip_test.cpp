// HDR-FLIP against its equations, with the tone mapper's constants as published.
#include <catch2/catch.hpp>
#include <cstdint>

#include "core/display.h"
#include "model/flip.h"
#include "model/metrics.h"

namespace lightstage {

namespace {

using core::Image;

// Equation of the publication's ACES fit: (k0 x^2 + k1 x + k2)/(k3 x^2 + k4 x + k5).
double tone_mapped(double x) {
  const double k0 = 0.6 * 0.6 * 2.51, k1 = 0.6 * 0.03, k3 = 0.6 * 0.6 * 2.43, k4 = 0.6 * 0.59, k5 = 0.14;
  return std::clamp((k0 * x * x + k1 * x) / (k3 * x * x + k4 * x + k5), 0.0, 1.0);
}

// Greys of luminance 1 with one bright pixel, and noise where there is a seed.
Image scene(float bright, std::uint32_t seed = 0) {
  Image image(12, 14, 3);
  for (float& v : image.values()) {
    seed = seed == 0 ? 0 : seed * 1664525u + 1013904223u;
    v = 1 + 0.3f * float(seed >> 8) / float(1 << 24);
  }
  for (int c = 0; c < 3; ++c) image(6, 7, c) = bright;
  return image;
}

Image times(Image image, float factor) {
  for (float& v : image.values()) v *= factor;
  return image;
}

}  // namespace

TEST_CASE("HDR-FLIP's exposures run from the brightest pixel to the median, both shown as 0.85") {
  const std::vector<double> stops = model::hdr_flip_stops(scene(16), scene(3), {});
  REQUIRE(stops.size() == 4);  // log2(16 / 1) = 4 stops
  CHECK(tone_mapped(16 * std::exp2(stops.front())) == Approx(0.85).epsilon(1e-6));
  CHECK(tone_mapped(1 * std::exp2(stops.back())) == Approx(0.85).epsilon(1e-6));
  CHECK(stops[1] - stops[0] == Approx(4.0 / 3));
  CHECK(stops[2] - stops[1] == Approx(4.0 / 3));
  // Two at least, 12 stops at most.
  CHECK(model::hdr_flip_stops(scene(1), scene(1), {}).size() == 2);
  Image shadow(5, 5, 1);
  shadow(2, 2) = 1e5f;
  const std::vector<double> widest = model::hdr_flip_stops(shadow, shadow, {});
  CHECK(widest.size() == 12);
  CHECK(widest.back() - widest.front() == Approx(12));
  // The mask decides what counts.
  Image mask(12, 14, 1);
  mask(6, 7) = 1;
  CHECK(model::hdr_flip_stops(scene(16), scene(16), mask).back() == Approx(stops.front()));
}

TEST_CASE("HDR-FLIP is the mean over the mask of the largest FLIP over the exposures") {
  const Image truth = scene(9, 1), picture = scene(4, 2);
  Image mask(12, 14, 1), largest(12, 14, 1);
  double sum = 0;
  for (const double stops : model::hdr_flip_stops(truth, picture, {})) {
    const auto shown = [stops](Image image) {
      for (float& v : image.values()) v = core::display_encode(float(tone_mapped(double(v) * std::exp2(stops))));
      return image;
    };
    const Image map = model::flip_map(shown(truth), shown(picture));
    for (std::size_t i = 0; i < map.values().size(); ++i)
      largest.values()[i] = std::max(largest.values()[i], map.values()[i]);
  }
  for (int y = 3; y < 9; ++y)
    for (int x = 2; x < 10; ++x) {
      mask(y, x) = 1;
      sum += double(largest(y, x));
    }
  const std::vector<double> all = model::hdr_flip_stops(truth, picture, {});
  const std::vector<double> masked = model::hdr_flip_stops(truth, picture, mask);
  REQUIRE(all.size() == masked.size());
  CHECK(model::hdr_flip(truth, picture, mask) == Approx(sum / 48).epsilon(0.02));
  double whole = 0;
  for (const float v : largest.values()) whole += double(v);
  CHECK(model::hdr_flip(truth, picture, {}) == Approx(whole / (12 * 14)).epsilon(1e-5));
}

TEST_CASE("HDR-FLIP sees what clipping hides, whatever the unit of light") {
  const Image truth = scene(200), picture = scene(20);
  CHECK(model::flip(truth, picture, {}) == 0);  // both clipped
  const double seen = model::hdr_flip(truth, picture, {});
  CHECK(seen > 0.01);
  for (const float unit : {1e-4f, 0.5f, 1000.0f})
    CHECK(model::hdr_flip(times(truth, unit), times(picture, unit), {}) == Approx(seen).epsilon(1e-3));
}

TEST_CASE("HDR-FLIP is 0 for equal pictures and finite at extremes") {
  const Image black(6, 6, 3), hot = scene(1e5f);
  CHECK(model::hdr_flip(hot, hot, {}) == 0);
  CHECK(model::hdr_flip(black, black, {}) == 0);
  Image picture(6, 6, 3);
  picture(3, 3, 1) = 2;
  picture(1, 1, 0) = -5;
  for (const double value : {model::hdr_flip(black, picture, {}), model::hdr_flip(picture, black, {})}) {
    CHECK(value > 0);
    CHECK(value <= 1);
  }
  // Exposed as the dark truth asks for, this is beyond float.
  const double overflowing = model::hdr_flip(times(scene(1), 1e-3f), scene(3e38f), {}),
               huge = model::hdr_flip(times(scene(1), 1e-3f), scene(1e30f), {});
  CHECK(overflowing > 0);
  CHECK(overflowing == Approx(huge));
  CHECK(model::hdr_flip(Image(1, 1, 1), Image(1, 1, 1), {}) == 0);
}

}  // namespace lightstage
