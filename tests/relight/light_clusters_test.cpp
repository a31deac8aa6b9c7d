// The tree of clusters: cuts through it against all cuts that there are, and what its error model promises.
#include <catch2/catch.hpp>
#include <limits>

#include "core/error.h"
#include "core/sphere.h"
#include "relight/light_clusters.h"

namespace lightstage {

namespace {

using core::Direction;
using core::Vec3;
using relight::Cut;
using relight::DoubtfulLight;
using relight::LightClusters;

constexpr double kInfinity = std::numeric_limits<double>::infinity();
const double kSpacing = core::radians_from_degrees(12);

std::vector<DoubtfulLight> random_lights(std::size_t count, std::uint64_t seed) {
  std::vector<DoubtfulLight> lights;
  std::uint32_t state = std::uint32_t(seed);
  const auto draw = [&] {
    state = state * 1664525u + 1013904223u;
    return double(state >> 8) / double(1 << 24);
  };
  for (const Direction& direction : core::random_directions(count, seed)) {
    const double light = std::pow(draw(), 6);
    lights.push_back({direction, {light, light * draw(), light * draw()}, 0.01 + 0.02 * draw(), true});
  }
  return lights;
}

Vec3 sum_of(const std::vector<relight::Representative>& lights) {
  Vec3 sum;
  for (const auto& light : lights) sum = sum + light.irradiance;
  return sum;
}

}  // namespace

TEST_CASE("one bright light among many is represented first, where it stands", "[clusters]") {
  std::vector<DoubtfulLight> lights;
  for (const Direction& direction : core::fibonacci_directions(2000))
    lights.push_back({direction, {1, 1, 1}, 0.02, true});
  const Direction sun = Direction::from_longitude_latitude_degrees(33, 41);
  lights.push_back({sun, {4000, 4000, 4000}, 0.02, true});
  const LightClusters clusters(lights, kSpacing);
  const Cut none = clusters.at_price(kInfinity);
  CHECK(none.representatives.empty());
  const Cut one = clusters.at_most(1);
  REQUIRE(one.representatives.size() == 1);
  CHECK(core::degrees_from_radians(core::angle_radians(one.representatives[0].direction, sun)) < 0.05);
  CHECK(one.representatives[0].irradiance.x == Approx(4000).epsilon(0.01));
  CHECK(one.variance.total() < 0.01 * none.variance.total());
  CHECK(none.variance.total() == Approx(one.variance.total() + one.representatives[0].saved.total()));
}

TEST_CASE("the cut at a price costs no more than any other cut", "[clusters]") {
  const std::vector<DoubtfulLight> lights = random_lights(300, 5);
  const LightClusters clusters(lights, kSpacing);
  std::vector<double> prices;
  std::vector<Cut> cuts;
  for (double price = 1e-12; price < 1; price *= 3) {
    prices.push_back(price);
    cuts.push_back(clusters.at_price(price));
  }
  const auto cost = [](const Cut& cut, double price) {
    return cut.variance.total() + price * double(cut.representatives.size());
  };
  std::size_t different = 0;
  for (std::size_t i = 0; i < cuts.size(); ++i) {
    for (std::size_t j = 0; j < cuts.size(); ++j)
      CHECK(cost(cuts[i], prices[i]) <= cost(cuts[j], prices[i]) * (1 + 1e-12));
    if (i == 0) continue;
    CHECK(cuts[i].representatives.size() <= cuts[i - 1].representatives.size());
    CHECK(cuts[i].variance.total() >= cuts[i - 1].variance.total() * (1 - 1e-12));
    different += cuts[i].representatives.size() != cuts[i - 1].representatives.size();
  }
  CHECK(different > 5);
}

TEST_CASE("numbers and variances that are asked for are kept", "[clusters]") {
  const LightClusters clusters(random_lights(2000, 9), kSpacing);
  const double all = clusters.at_price(kInfinity).variance.total();
  for (const std::size_t count : {0, 1, 2, 7, 50, 500, 5000})
    CHECK(clusters.at_most(count).representatives.size() <= count);
  CHECK(clusters.at_most(50).representatives.size() > 40);
  std::size_t before = 0;
  for (const double share : {2.0, 1.0, 0.3, 0.1, 0.01, 0.0001}) {
    const Cut cut = clusters.within(share * all);
    CHECK(cut.variance.total() <= share * all);
    CHECK(cut.representatives.size() >= before);
    before = cut.representatives.size();
  }
  CHECK(before > 20);
}

TEST_CASE("what is wrong in holes and between lights counts as it is weighed", "[clusters]") {
  std::vector<DoubtfulLight> lights = random_lights(400, 3);
  const Direction between = Direction::from_longitude_latitude_degrees(10, 20),
                  in_hole = Direction::from_longitude_latitude_degrees(50, -80);
  lights.push_back({between, {30, 30, 30}, 0.02, true});
  lights.push_back({in_hole, {20, 20, 20}, 0.02, false});
  const LightClusters clusters(lights, kSpacing);
  const auto first = [&](const relight::ByPlace& weights) {
    const Cut cut = clusters.at_most(1, weights);
    REQUIRE(cut.representatives.size() == 1);
    return cut.representatives[0].direction;
  };
  CHECK(core::angle_radians(first({1, 1}), between) < 0.01);
  CHECK(core::angle_radians(first({1, 100}), in_hole) < 0.01);
  const relight::ByPlace all = clusters.at_price(kInfinity).variance;
  CHECK(all.in_holes == Approx(0.16).epsilon(0.3));
  CHECK(all.total() == Approx(all.between_lights + all.in_holes));
  const Cut cut = clusters.within(0.05 * all.weighed({1, 100}), {1, 100});
  CHECK(cut.variance.weighed({1, 100}) <= 0.05 * all.weighed({1, 100}));
  CHECK(cut.variance.in_holes < 0.05 * all.in_holes);
}

TEST_CASE("light is neither lost nor doubled by clusters", "[clusters]") {
  const std::vector<DoubtfulLight> lights = random_lights(500, 3);
  const LightClusters clusters(lights, kSpacing);
  for (const std::size_t count : {5, 60, 400}) {
    const Cut cut = clusters.at_most(count);
    Vec3 represented;
    for (std::size_t i = 0; i < lights.size(); ++i)
      if (cut.represented[i]) represented = represented + lights[i].irradiance;
    const Vec3 sum = sum_of(cut.representatives);
    CHECK(sum.x == Approx(represented.x));
    CHECK(sum.y == Approx(represented.y));
    CHECK(sum.z == Approx(represented.z));
  }
}

TEST_CASE("light that stands on a captured light, and no light, need no synthesis", "[clusters]") {
  std::vector<DoubtfulLight> lights = random_lights(100, 4);
  for (DoubtfulLight& light : lights) light.error = 0;
  CHECK(LightClusters(lights, kSpacing).within(0).representatives.empty());
  for (DoubtfulLight& light : lights) light = {light.direction, {}, 1, true};
  CHECK(LightClusters(lights, kSpacing).at_most(10).representatives.empty());
  CHECK(LightClusters(lights, kSpacing).doubts().empty());
  CHECK_THROWS_AS(LightClusters({}, kSpacing), core::UsageError);
}

TEST_CASE("parts of a piece are wrong together: leaving both halves out costs what leaving out the piece does",
          "[clusters]") {
  // Two lights a tenth of the spacing apart, and the same two lights four spacings apart.
  const auto variance = [](double degrees) {
    const std::vector<DoubtfulLight> lights{
        {Direction::from_longitude_latitude_degrees(0, 0), {1, 1, 1}, 0.1, true},
        {Direction::from_longitude_latitude_degrees(degrees, 0), {1, 1, 1}, 0.1, true}};
    return LightClusters(lights, kSpacing).at_price(kInfinity).variance.total();
  };
  CHECK(variance(1.2) == Approx(4 * 0.01));
  CHECK(variance(48) == Approx(2 * 0.01));
  // A light and its opposite cancel only where they are near.
  const std::vector<DoubtfulLight> opposite{
      {Direction::from_longitude_latitude_degrees(0, 0), {1, 1, 1}, 0.1, true},
      {Direction::from_longitude_latitude_degrees(1, 0), {-1, -1, -1}, 0.1, true}};
  CHECK(LightClusters(opposite, kSpacing).at_price(kInfinity).variance.total() == Approx(0).margin(1e-15));
}

}  // namespace lightstage
