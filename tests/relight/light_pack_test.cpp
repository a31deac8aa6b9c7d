// Packs against the pictures that they were made of.
#include <catch2/catch.hpp>
#include <memory>
#include <numbers>
#include <random>

#include "core/display.h"
#include "core/error.h"
#include "core/parallel.h"
#include "core/sphere.h"
#include "model/methods.h"
#include "model/synthetic_scan.h"
#include "relight/environment_relighter.h"
#include "relight/light_pack.h"
#include "relight/relight.h"

namespace lightstage {

namespace {

using core::Direction;
using core::Image;
using core::Vec3;
using relight::LightPack;
using relight::PackedScan;

constexpr core::ImageSize kSize{19, 23, 3};

Image under(const model::LightInterpolator& method, const relight::Environment& environment) {
  const relight::EnvironmentReport report =
      relight::EnvironmentRelighter(method).relight(environment, relight::Exhaustive{});
  CHECK(report.directions_synthesised == 0);
  return report.image;
}

// A ball with a highlight: more than the three dimensions of a matt one, and no sharp end to them.
core::OlatScan glossy_scan(const std::vector<Direction>& lights, core::ImageSize size = kSize, Image mask = {}) {
  const auto value = [size, matt = test::matt_ball(size)](const Direction& light, int y, int x, int c) {
    const double shade = matt(light, y, x, c);
    return shade + 3 * std::pow(shade, 12);
  };
  return test::scan_of(lights, size, value, std::move(mask));
}

// Pictures that have nothing in common.
core::OlatScan noise_scan(std::size_t lights) {
  const auto value = [](const Direction& light, int y, int x, int c) {
    std::mt19937 random(unsigned(1e4 * (light.x() + 2)) * 31 + unsigned((y * 64 + x) * 4 + c));
    random.discard(4);
    return double(random()) / 4294967296.0;
  };
  return test::scan_of(core::fibonacci_directions(lights), kSize, value);
}

Image disc_mask(core::ImageSize size) {
  Image mask(size.height, size.width, 1);
  for (int y = 0; y < size.height; ++y)
    for (int x = 0; x < size.width; ++x)
      mask(y, x) = std::hypot(y - size.height / 2.0, x - size.width / 2.0) < size.height / 3.0 ? 1.0f : 0.0f;
  return mask;
}

// The errors of a pack written out, from the pictures that it gives back one by one.
relight::PackErrors plain_errors(const PackedScan& packed, const core::OlatScan& scan, double exposure) {
  const std::vector<double> solid_angles = core::voronoi_solid_angles(scan.directions());
  double energy = 0, error = 0, worst = 0, display = 0, weight = 0, values = 0;
  for (std::size_t light = 0; light < scan.light_count(); ++light) {
    std::vector<Vec3> colours(scan.light_count());
    colours[light] = {1, 1, 1};
    const Image becomes = packed.lit_by(colours), is = core::to_rgb(*scan.image(light));
    double squared = 0;
    for (int y = 0; y < is.height(); ++y)
      for (int x = 0; x < is.width(); ++x)
        for (int c = 0; c < 3; ++c) {
          if (!(scan.mask()(y, x) > 0.5f)) {
            REQUIRE(becomes(y, x, c) == 0);
            continue;
          }
          const double a = double(is(y, x, c)), b = double(becomes(y, x, c));
          squared += (a - b) * (a - b);
          energy += solid_angles[light] * a * a;
          const auto shown = [&](double v) { return std::pow(std::clamp(v / exposure, 0.0, 1.0), 1 / 2.2); };
          display += std::pow(shown(a) - shown(b), 2);
          values += 1;
        }
    error += solid_angles[light] * squared;
    weight += solid_angles[light];
    worst = std::max(worst, squared);
  }
  return {std::sqrt(error / energy), std::sqrt(worst / (energy / weight)), std::sqrt(display / values)};
}

void require_halves(const LightPack& pack) {
  for (const Image& picture : pack.basis)
    for (const float v : picture.values()) {
      int exponent = 0;
      const float eleven_digits = std::ldexp(std::frexp(v, &exponent), 11);
      REQUIRE(eleven_digits == std::nearbyint(eleven_digits));
      REQUIRE(std::abs(v) <= 65504);
      REQUIRE((v == 0 || std::abs(v) >= 0x1p-14f));
    }
}

double largest_difference(const Image& a, const Image& b) {
  REQUIRE(a.size() == b.size());
  double largest = 0;
  for (std::size_t i = 0; i < a.values().size(); ++i)
    largest = std::max(largest, std::abs(double(a.values()[i]) - double(b.values()[i])));
  return largest;
}

}  // namespace

TEST_CASE(
    "a pack keeps the error asked for and states what it measures, on grey and coloured scans with and without mask") {
  for (const double error : {0.1, 0.01, 0.001}) {
    for (const core::ImageSize size : {kSize, core::ImageSize{17, 16, 1}}) {
      for (const bool masked : {false, true}) {
        CAPTURE(error, size.channels, masked);
        // At most 64 lights, so that all are looked at for the display-encoded error.
        const core::OlatScan scan =
            glossy_scan(core::fibonacci_directions(60), size, masked ? disc_mask(size) : Image());
        const LightPack pack = relight::compress(scan, error, 0.8);
        CHECK(pack.rank() < 60);
        CHECK(pack.errors.relative <= error);
        CHECK(pack.errors.relative > 0.3 * error);
        require_halves(pack);
        const relight::PackErrors plain = plain_errors(PackedScan(pack, scan), scan, 0.8);
        CHECK(pack.errors.relative == Approx(plain.relative).epsilon(1e-3));
        CHECK(pack.errors.largest_light == Approx(plain.largest_light).epsilon(1e-3));
        CHECK(pack.errors.display == Approx(plain.display).epsilon(1e-3));
      }
    }
  }
}

TEST_CASE("pictures that have nothing in common need a basis picture each") {
  const core::OlatScan scan = noise_scan(40);
  const LightPack pack = relight::compress(scan, 0.001, 1);
  CHECK(pack.rank() == 40);
  const PackedScan packed(pack, scan);
  std::vector<Vec3> one(40);
  one[17] = {1, 1, 1};
  CHECK(largest_difference(packed.lit_by(one), *scan.image(17)) < 0.003);
}

TEST_CASE("a smaller error costs more basis pictures and never comes out worse") {
  const core::OlatScan scan = glossy_scan(core::fibonacci_directions(90));
  std::size_t rank = 0;
  double relative = 1;
  for (const double error : {0.3, 0.1, 0.03, 0.01, 0.003, 0.001}) {
    const LightPack pack = relight::compress(scan, error, 1);
    CHECK(pack.rank() >= rank);
    CHECK(pack.errors.relative < relative);
    rank = pack.rank();
    relative = pack.errors.relative;
  }
}

TEST_CASE("packs of black scans, of one light and of lights in one place") {
  const core::OlatScan black = test::scan_of(core::fibonacci_directions(9), kSize, [](auto&&...) { return 0.0; });
  const LightPack nothing = relight::compress(black, 0.01, 1);
  CHECK(nothing.rank() == 0);
  CHECK(nothing.errors.relative == 0);
  CHECK(PackedScan(nothing, black).render(Direction()) == Image(kSize));

  const core::OlatScan single = glossy_scan({Direction::from_vector({0.2, 0.1, 1})});
  const LightPack one = relight::compress(single, 0.001, 1);
  CHECK(one.rank() == 1);
  CHECK(largest_difference(PackedScan(one, single).render(Direction::from_vector({-1, 0, 0})), *single.image(0)) <
        0.01);

  const core::OlatScan twins = glossy_scan(std::vector<Direction>(70, Direction::from_vector({0, 1, 2})));
  const LightPack same = relight::compress(twins, 0.001, 1);
  CHECK(same.rank() == 1);
  CHECK(same.errors.largest_light <= 0.0011);
}

TEST_CASE("hot pixels neither overflow a pack nor make it infinite") {
  const auto value = [matt = test::matt_ball(kSize)](const Direction& light, int y, int x, int c) {
    return y == 9 && x == 11 && light.z() > 0.9 ? 1e5 : matt(light, y, x, c);
  };
  const core::OlatScan scan = test::scan_of(core::fibonacci_directions(50), kSize, value);
  for (const double error : {0.1, 0.001}) {
    const LightPack pack = relight::compress(scan, error, 1);
    require_halves(pack);
    CHECK(pack.errors.relative <= error);
    const PackedScan packed(pack, scan);
    CHECK(plain_errors(packed, scan, 1).relative == Approx(pack.errors.relative).epsilon(0.01));
    const Image lit = packed.render(Direction::from_vector({0, 0, 1}));
    for (const float v : lit.values()) REQUIRE(std::isfinite(v));
    CHECK(lit(9, 11) == Approx(1e5).epsilon(2 * error));
  }
  // Denormal values, too, are only values.
  const core::OlatScan faint =
      test::scan_of(core::fibonacci_directions(12), kSize,
                    [ball = test::matt_ball(kSize)](auto&&... at) { return 1e-12 * ball(at...); });
  CHECK(relight::compress(faint, 0.01, 1).errors.relative <= 0.01);
}

TEST_CASE("relighting from a pack is relighting from its scan, to the error stated") {
  const core::OlatScan scan = glossy_scan(core::fibonacci_directions(200));
  const LightPack pack = relight::compress(scan, 0.01, 1);
  const PackedScan packed(pack, scan);
  const auto dense = model::make_interpolator("barycentric", scan, {.domain = model::Domain::kLinear});

  // A constant map: the sum of all lights by their solid angles, in units of pi.
  Image white(16, 32, 3);
  std::fill(white.values().begin(), white.values().end(), 1.0f);
  const relight::Environment constant{white};
  const Image by_pack = under(packed, constant);
  const std::vector<double> solid_angles = core::voronoi_solid_angles(scan.directions());
  Image by_hand(kSize);
  double scale = 0;
  for (std::size_t v = 0; v < by_hand.values().size(); ++v) {
    double sum = 0;
    for (std::size_t i = 0; i < scan.light_count(); ++i)
      sum += solid_angles[i] / std::numbers::pi * double(scan.image(i)->values()[v]);
    by_hand.values()[v] = float(sum);
    scale = std::max(scale, sum);
  }
  CHECK(largest_difference(by_pack, by_hand) < 0.02 * scale);
  double light = 0;
  std::vector<relight::DistantLight> all = constant.lights(0);
  for (const Vec3 colour : packed.captured_colours(all)) light += colour.y;
  CHECK(light == Approx(4).epsilon(1e-6));

  // A bright dot, coloured, and many lights.
  Image map(64, 128, 3);
  for (int y = 0; y < 64; ++y)
    for (int x = 0; x < 128; ++x)
      for (int c = 0; c < 3; ++c) map(y, x, c) = float(0.3 + 0.2 * std::sin(0.1 * x + c) + 0.004 * y);
  map(20, 50, 0) = 1e4f;
  const relight::Environment sky{map};
  const Image a = under(packed, sky), b = under(*dense, sky);
  double squared = 0, energy = 0;
  for (std::size_t i = 0; i < a.values().size(); ++i) {
    squared += std::pow(double(a.values()[i]) - double(b.values()[i]), 2);
    energy += std::pow(double(b.values()[i]), 2);
  }
  CHECK(std::sqrt(squared / energy) < 2 * pack.errors.largest_light);

  // One direction, from the weights.
  const Direction between = Direction::from_vector({0.3, 0.2, 0.9});
  CHECK(largest_difference(packed.render(between), relight::relight_direction(packed, between).image) < 1e-6);
  CHECK(largest_difference(packed.render(between), dense->render(between)) < 0.1);
}

TEST_CASE("packs and what is relit from them are the same on every number of threads") {
  const core::OlatScan scan = glossy_scan(core::fibonacci_directions(150), {33, 47, 3});
  Image map(20, 40, 3);
  for (std::size_t i = 0; i < map.values().size(); ++i) map.values()[i] = float(i % 17);
  const auto on = [&](int threads) {
    core::set_thread_count(threads);
    const LightPack pack = relight::compress(scan, 0.01, 1);
    Image image = under(PackedScan(pack, scan), relight::Environment{map});
    core::set_thread_count(0);
    return std::tuple(pack.basis, pack.coefficients, std::move(image));
  };
  const auto one = on(1);
  CHECK(on(2) == one);
  CHECK(on(5) == one);
}

TEST_CASE("packs that cannot be made or are of another scan are refused") {
  const core::OlatScan scan = glossy_scan(core::fibonacci_directions(20));
  for (const double error : {0.0, 0.0001, 0.6, -1.0, double(NAN)})
    CHECK_THROWS_AS(relight::compress(scan, error, 1), core::UsageError);
  for (const double exposure : {0.0, -1.0, double(INFINITY), double(NAN)})
    CHECK_THROWS_AS(relight::compress(scan, 0.1, exposure), core::UsageError);
  const LightPack pack = relight::compress(scan, 0.1, 1);
  CHECK_THROWS_AS(PackedScan(pack, glossy_scan(core::fibonacci_directions(21))), core::BadInput);
  CHECK_THROWS_AS(PackedScan(pack, glossy_scan(core::fibonacci_directions(20), {18, 23, 3})), core::BadInput);
  CHECK_THROWS_AS(PackedScan(pack, scan).lit_by(std::vector<Vec3>(19)), core::BadInput);
  CHECK_THROWS_AS(PackedScan(pack, scan).lit_by(std::vector<Vec3>(20, Vec3{NAN, 0, 0})), core::BadInput);
}

TEST_CASE("masked pixels go into a row and back") {
  const Image mask = disc_mask(kSize);
  Image picture(kSize);
  for (std::size_t i = 0; i < picture.values().size(); ++i) picture.values()[i] = float(i);
  const Image row = relight::masked_pixels(picture, mask);
  const Image back = relight::unmasked(row, mask);
  for (int y = 0; y < kSize.height; ++y)
    for (int x = 0; x < kSize.width; ++x)
      for (int c = 0; c < 3; ++c) REQUIRE(back(y, x, c) == (mask(y, x) > 0.5f ? picture(y, x, c) : 0));
  CHECK(relight::masked_pixels(back, mask) == row);
  CHECK_THROWS_AS(relight::unmasked(Image(1, row.width() + 1, 3), mask), core::BadInput);
  CHECK_THROWS_AS(relight::masked_pixels(Image(3, 3, 3), mask), core::BadInput);
}

}  // namespace lightstage
