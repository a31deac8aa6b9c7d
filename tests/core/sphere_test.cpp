#include "core/sphere.h"

#include <algorithm>
#include <catch2/catch.hpp>
#include <numbers>
#include <numeric>

#include "core/error.h"
#include "core/parallel.h"

using namespace lightstage;
using core::Direction;

namespace {

constexpr double kPi = std::numbers::pi;

// Worked out apart from this program, with integers and correctly rounded square roots.
constexpr core::Vec3 kFirstOfSeed0{-0x1.3e5ec9ba72cb7p-1, 0x1.0da7bb37ce96bp-3, -0x1.8b45912c5b33ap-1};

core::Vec3 sum_of(const std::vector<Direction>& directions) {
  core::Vec3 sum;
  for (const Direction& d : directions) sum = sum + d.vec();
  return sum;
}

double smallest_spacing(const std::vector<Direction>& directions) {
  double smallest = kPi;
  for (std::size_t i = 0; i < directions.size(); ++i)
    for (std::size_t j = 0; j < i; ++j) smallest = std::min(smallest, angle_radians(directions[i], directions[j]));
  return smallest;
}

}  // namespace

TEST_CASE("Fibonacci directions are spread evenly from +y to -y") {
  CHECK_THROWS_AS(core::fibonacci_directions(0), core::UsageError);
  CHECK(core::fibonacci_directions(1).size() == 1);
  for (const std::size_t n : {2U, 7U, 331U, 2000U}) {
    const std::vector<Direction> d = core::fibonacci_directions(n);
    REQUIRE(d.size() == n);
    CHECK(std::is_sorted(d.begin(), d.end(), [](const Direction& a, const Direction& b) { return a.y() > b.y(); }));
    // Even bands of area: y runs in equal steps.
    for (std::size_t i = 0; i < n; ++i) CHECK(d[i].y() == Approx(1 - (2.0 * double(i) + 1) / double(n)).margin(1e-14));
  }
  const std::vector<Direction> many = core::fibonacci_directions(2000);
  CHECK(core::norm(sum_of(many)) < 1);
  // A hexagonal packing of n caps has spacing sqrt(8 pi / (sqrt(3) n)) = 3.81 / sqrt(n); this lattice stays
  // within 20% of it.
  CHECK(smallest_spacing(many) > 0.8 * 3.81 / std::sqrt(2000.0));
}

TEST_CASE("geodesic directions are the vertices of a split icosahedron") {
  for (const auto& [wanted, made] :
       {std::pair{0, 12}, {12, 12}, {13, 42}, {42, 42}, {43, 92}, {162, 162}, {150, 162}}) {
    const std::vector<Direction> d = core::geodesic_directions(std::size_t(wanted));
    CHECK(d.size() == std::size_t(made));
    CHECK(core::norm(sum_of(d)) < 1e-12);
    // All different, and about evenly spread.
    CHECK(smallest_spacing(d) > 0.7 * 3.81 / std::sqrt(double(made)));
  }
  CHECK(smallest_spacing(core::geodesic_directions(12)) == Approx(std::atan(2.0)));
}

TEST_CASE("random directions are uniform and the same for a seed on every machine") {
  const std::vector<Direction> d = core::random_directions(20000, 7);
  CHECK(d == core::random_directions(20000, 7));
  CHECK_FALSE(d.front() == core::random_directions(1, 8).front());
  const std::vector<Direction> fewer = core::random_directions(10, 7);
  CHECK(std::equal(fewer.begin(), fewer.end(), d.begin()));
  // Means are 0 and squares 1/3 within five standard errors.
  double xx = 0, yy = 0, zz = 0;
  for (const Direction& v : d) xx += v.x() * v.x(), yy += v.y() * v.y(), zz += v.z() * v.z();
  CHECK(core::norm(sum_of(d)) / 20000 < 5 / std::sqrt(20000.0));
  for (const double square : {xx, yy, zz})
    CHECK(square / 20000 == Approx(1.0 / 3).margin(5 * 0.3 / std::sqrt(20000.0)));
  // Fixed by the C++ standard's mt19937_64 and IEEE 754 alone.
  const Direction first = core::random_directions(1, 0).front();
  CHECK(first.x() == kFirstOfSeed0.x);
  CHECK(first.y() == kFirstOfSeed0.y);
  CHECK(first.z() == kFirstOfSeed0.z);
}

TEST_CASE("nearest indices agree with sorting everything") {
  std::vector<Direction> d = core::random_directions(203, 3);
  d.push_back(d[5]);  // a duplicate: ties go to the lower index
  d.push_back(d[5]);
  for (const Direction& query : core::random_directions(20, 4)) {
    std::vector<std::size_t> order(d.size());
    std::iota(order.begin(), order.end(), std::size_t(0));
    std::stable_sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) {
      return core::norm(d[a].vec() - query.vec()) < core::norm(d[b].vec() - query.vec());
    });
    for (const std::size_t k : {0U, 1U, 8U, 204U, 205U, 500U}) {
      const std::vector<std::size_t> expected(order.begin(),
                                              order.begin() + std::ptrdiff_t(std::min<std::size_t>(k, d.size())));
      CHECK(core::nearest_indices(d, query, k) == expected);
    }
  }
  CHECK(core::nearest_indices(d, d[5], 4)[0] == 5);
  CHECK(core::nearest_indices(d, d[5], 4)[1] == 203);
  CHECK(core::nearest_indices(d, d[5], 4)[2] == 204);
  CHECK(core::nearest_indices({}, d[5], 4).empty());
}

TEST_CASE("lights closer than a dot product can tell are still put in order") {
  const auto tilted = [](double angle) { return Direction::from_vector({std::sin(angle), 0, std::cos(angle)}); };
  const std::vector<Direction> d{tilted(3e-9), tilted(1e-9), tilted(-2e-9)};
  CHECK(core::nearest_indices(d, Direction(), 3) == std::vector<std::size_t>{1, 2, 0});
}

TEST_CASE("the median spacing is the angle to the nearest other light") {
  CHECK(core::median_spacing_radians(core::geodesic_directions(12)) == Approx(std::atan(2.0)));
  CHECK(core::median_spacing_radians({}) == kPi);
  const std::vector<Direction> one(3);
  CHECK(core::median_spacing_radians(one) == kPi);  // three times the same light
  const auto tilted = [](double degrees) { return Direction::from_longitude_latitude_degrees(degrees, 0); };
  CHECK(core::median_spacing_radians(std::vector{tilted(0), tilted(180)}) == Approx(kPi));
  // Nearest others: 10, 10, 20, 50 degrees; the duplicate at 30 does not shorten its twin's.
  const std::vector<Direction> d{tilted(0), tilted(10), tilted(30), tilted(30), tilted(80)};
  CHECK(core::median_spacing_radians(d) == Approx(core::radians_from_degrees(20)));
  CHECK(core::median_spacing_radians(std::vector{tilted(0), tilted(10), tilted(40), tilted(90)}) ==
        Approx(core::radians_from_degrees(20)));
}

TEST_CASE("solid angles of cells sum to the sphere and are shared by duplicates") {
  std::vector<Direction> d = core::geodesic_directions(12);
  const std::vector<double> even = core::voronoi_solid_angles(d);
  for (const double angle : even) CHECK(angle == Approx(4 * kPi / 12).epsilon(0.005));
  d.push_back(d[0]);
  const std::vector<double> shared = core::voronoi_solid_angles(d);
  CHECK(std::accumulate(shared.begin(), shared.end(), 0.0) == Approx(4 * kPi).epsilon(1e-13));
  CHECK(shared[0] == shared[12]);
  CHECK(shared[0] == Approx(4 * kPi / 24).epsilon(0.005));
  // One light in a hemisphere of its own: the bisecting plane decides.
  const std::vector<Direction> poles{Direction::from_vector({0, 1, 0}), Direction::from_vector({0, -1, 0})};
  CHECK(core::voronoi_solid_angles(poles)[0] == Approx(2 * kPi).epsilon(1e-4));
  CHECK(core::voronoi_solid_angles({}).empty());
  CHECK_THROWS_AS(core::voronoi_solid_angles(poles, 0), core::UsageError);
}

TEST_CASE("the neighbouring order visits every direction once, in short steps") {
  for (const std::size_t n : {1, 2, 7, 302, 5000}) {
    CAPTURE(n);
    const std::vector<Direction> directions = core::fibonacci_directions(n);
    std::vector<std::size_t> order = core::neighbouring_order(directions);
    CHECK(order == core::neighbouring_order(directions));
    double steps = 0;
    for (std::size_t i = 1; i < order.size(); ++i)
      steps += angle_radians(directions[order[i - 1]], directions[order[i]]);
    // Ways that visit all points in a row are a spacing a step at best.
    if (n > 2) CHECK(steps / double(n - 1) < 1.6 * core::median_spacing_radians(directions));
    std::sort(order.begin(), order.end());
    std::vector<std::size_t> all(n);
    std::iota(all.begin(), all.end(), std::size_t(0));
    CHECK(order == all);
  }
  CHECK(core::neighbouring_order({}).empty());
}

TEST_CASE("the neighbouring order knows poles, axes and duplicates") {
  std::vector<Direction> directions;
  for (const double sign : {1.0, -1.0, 1.0})
    for (const core::Vec3 axis : {core::Vec3{1, 0, 0}, core::Vec3{0, 1, 0}, core::Vec3{0, 0, 1}})
      directions.push_back(Direction::from_vector(sign * axis));
  const std::vector<std::size_t> order = core::neighbouring_order(directions);
  REQUIRE(order.size() == 9);
  const auto place = [&](std::size_t i) { return std::find(order.begin(), order.end(), i) - order.begin(); };
  for (const std::size_t i : {0, 1, 2}) CHECK(place(i + 6) == place(i) + 1);
}

TEST_CASE("solid angles do not depend on the thread count") {
  const std::vector<Direction> d = core::random_directions(57, 1);
  core::set_thread_count(1);
  const std::vector<double> alone = core::voronoi_solid_angles(d, 30011);
  core::set_thread_count(5);
  CHECK(core::voronoi_solid_angles(d, 30011) == alone);
  core::set_thread_count(0);
}
