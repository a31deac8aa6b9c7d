// Spherical Delaunay triangulation and its weights.
#include <algorithm>
#include <catch2/catch.hpp>
#include <numbers>
#include <set>

#include "core/parallel.h"
#include "core/sphere.h"
#include "model/classical.h"
#include "model/classical/sphere_triangulation.h"
#include "model/synthetic_scan.h"
#include "support/support.h"

namespace lightstage {

namespace {

using core::Direction;
using core::Vec3;
using model::SphereTriangle;
using model::SphereTriangulation;

std::unique_ptr<model::LightInterpolator> barycentric_over(const std::vector<Direction>& lights) {
  return model::make_barycentric(test::scan_of(lights, {1, 1, 1}, [](auto&&...) { return 1.0; }),
                                 model::Domain::kLinear);
}

std::vector<Vec3> vectors(const std::vector<Direction>& directions) {
  std::vector<Vec3> result;
  for (const Direction& d : directions) result.push_back(d.vec());
  return result;
}

std::vector<Direction> ring(std::size_t n, double latitude_degrees) {
  std::vector<Direction> lights;
  for (std::size_t i = 0; i < n; ++i)
    lights.push_back(Direction::from_longitude_latitude_degrees(360.0 * double(i) / double(n), latitude_degrees));
  return lights;
}

// Rows of equally many lights on circles of latitude: four on a circle everywhere.
std::vector<Direction> dome(double lowest_degrees, std::size_t rows, std::size_t columns, bool with_pole) {
  std::vector<Direction> lights;
  for (std::size_t r = 0; r < rows; ++r) {
    const double latitude = lowest_degrees + (85 - lowest_degrees) * double(r) / double(rows - 1);
    for (const Direction& light : ring(columns, latitude)) lights.push_back(light);
  }
  if (with_pole) lights.push_back(Direction::from_vector({0, 1, 0}));
  return lights;
}

std::vector<Direction> turned(const std::vector<Direction>& directions) {
  const core::Mat3 turn = core::rotation_about({1, 2, -1}, 0.7);
  std::vector<Direction> result;
  for (const Direction& d : directions) result.push_back(Direction::from_vector(turn * d.vec()));
  return result;
}

// Everything a triangulation of the sphere must be, told from the points alone.
void require_delaunay(const SphereTriangulation& triangulation) {
  const auto& points = triangulation.points();
  const auto& triangles = triangulation.triangles();
  REQUIRE(triangles.size() == 2 * points.size() - 4);  // Euler, with every point in it
  std::set<std::pair<std::size_t, std::size_t>> edges;
  std::set<std::size_t> corners;
  double signed_volume = 0;
  for (const SphereTriangle& t : triangles) {
    const auto [a, b, c] = t.corners;
    for (const auto& edge : {std::pair(a, b), std::pair(b, c), std::pair(c, a)}) {
      REQUIRE(edges.insert(edge).second);  // no overlap
      corners.insert(edge.first);
    }
    const Vec3 normal = core::cross(points[b] - points[a], points[c] - points[a]);
    for (const Vec3 p : points) REQUIRE(core::dot(normal, p - points[a]) < 1e-11);  // an empty cap
    for (const std::size_t corner : t.corners)
      CHECK(std::cos(t.cap_radius) == Approx(core::dot(t.cap_centre, points[corner])).margin(1e-9));
    signed_volume += core::dot(points[a], core::cross(points[b], points[c]));
  }
  for (const auto& [from, to] : edges) REQUIRE(edges.contains({to, from}));  // no gap
  CHECK(corners.size() == points.size());
  CHECK(signed_volume > 0);
}

std::vector<std::vector<Direction>> difficult_stages() {
  std::vector<std::vector<Direction>> stages;
  for (const std::size_t n : {1u, 2u, 3u, 4u, 5u, 7u}) stages.push_back(core::random_directions(n, n));
  stages.push_back({Direction(), Direction::from_vector({0, 0, -1})});                                     // opposite
  stages.push_back({Direction(), Direction::from_vector({0, 0, -1}), Direction::from_vector({0, 1, 0})});  // one plane
  stages.push_back(std::vector<Direction>(5));  // all in one place
  stages.push_back(ring(24, 0));
  stages.push_back(ring(24, 40));
  stages.push_back(turned(ring(24, 40)));
  stages.push_back(turned(ring(24, 0)));
  stages.push_back(dome(5, 7, 24, true));
  stages.push_back(turned(dome(5, 7, 24, false)));
  stages.push_back(turned(dome(-60, 13, 36, true)));
  stages.push_back({Direction::from_vector({1, 0, 0}), Direction::from_vector({-1, 0, 0}),
                    Direction::from_vector({0, 1, 0}), Direction::from_vector({0, -1, 0}),
                    Direction::from_vector({0, 0, 1}), Direction::from_vector({0, 0, -1})});
  std::vector<Direction> cube;
  for (const double x : {-1.0, 1.0})
    for (const double y : {-1.0, 1.0})
      for (const double z : {-1.0, 1.0}) cube.push_back(Direction::from_vector({x, y, z}));
  stages.push_back(cube);
  std::vector<Direction> cluster;  // all within a hundredth of a radian
  for (const Direction& d : core::random_directions(30, 5))
    cluster.push_back(Direction::from_vector(Vec3{0, 0, 1} + 0.01 * d.vec()));
  stages.push_back(cluster);
  std::vector<Direction> pairs = core::fibonacci_directions(60);  // every light has a twin half a degree away
  for (std::size_t i = 0; i < 60; ++i) pairs.push_back(Direction::from_vector(pairs[i].vec() + Vec3{0.006, 0.005, 0}));
  stages.push_back(pairs);
  stages.push_back(core::geodesic_directions(162));
  stages.push_back(core::random_directions(200, 9));
  return stages;
}

double distance(const std::vector<double>& a, const std::vector<double>& b) {
  double sum = 0;
  for (std::size_t i = 0; i < a.size(); ++i) sum += std::abs(a[i] - b[i]);
  return sum;
}

}  // namespace

TEST_CASE("the triangulation is Delaunay and closed for random, geodesic and cocircular points") {
  for (const std::size_t n : {4u, 5u, 6u, 30u, 400u})
    require_delaunay(SphereTriangulation(vectors(core::random_directions(n, n))));
  for (const std::size_t n : {12u, 42u, 162u, 642u})
    require_delaunay(SphereTriangulation(vectors(core::geodesic_directions(n))));
  for (const bool pole : {true, false}) {
    require_delaunay(SphereTriangulation(vectors(dome(0, 8, 30, pole))));
    require_delaunay(SphereTriangulation(vectors(turned(dome(-80, 12, 30, pole)))));
  }
  // Points added later are in it as those given first are.
  SphereTriangulation grown(vectors(ring(12, 20)));
  for (const Vec3 p : vectors(core::random_directions(100, 3))) grown.add(p);
  require_delaunay(grown);
}

TEST_CASE("points that do not span space get company until they do") {
  for (const auto& lights :
       {core::random_directions(1, 1), core::random_directions(2, 2), core::random_directions(3, 3), ring(2, 0),
        ring(3, 0), ring(24, 0), ring(24, 40), turned(ring(24, 40))}) {
    const SphereTriangulation triangulation(vectors(lights));
    CAPTURE(lights.size());
    for (std::size_t i = 0; i < lights.size(); ++i) CHECK(triangulation.points()[i] == lights[i].vec());
    CHECK(triangulation.triangles().size() == 2 * triangulation.points().size() - 4);
  }
}

TEST_CASE("barycentric weights are exact at the lights, non-negative, and sum to 1 on every stage") {
  for (const auto& lights : difficult_stages()) {
    CAPTURE(lights.size());
    const auto method = barycentric_over(lights);
    for (const Direction& light : lights) {
      const auto exact = method->linear_weights(light);
      double there = 0, beside = 0;
      const auto near = method->linear_weights(Direction::from_vector(light.vec() + Vec3{1e-11, -1e-11, 1e-11}));
      for (std::size_t i = 0; i < lights.size(); ++i) {
        if (core::angle_radians(lights[i], light) > 1e-4) continue;
        there += exact[i];
        beside += near[i];
      }
      CHECK(there == Approx(1).epsilon(1e-15));
      CHECK(beside == Approx(1).epsilon(1e-6));
    }
    std::vector<Direction> queries = core::random_directions(300, 4);
    for (const Direction& light : lights) queries.push_back(Direction::from_vector(-light.vec()));
    for (const Direction& query : queries) {
      double sum = 0;
      for (const double w : method->linear_weights(query)) {
        REQUIRE(w >= 0);
        sum += w;
      }
      REQUIRE(sum == Approx(1).epsilon(1e-12));
    }
  }
}

TEST_CASE("barycentric weights are continuous along arcs through lights, edges, holes and poles of every stage") {
  for (const auto& lights : difficult_stages()) {
    CAPTURE(lights.size());
    const auto method = barycentric_over(lights);
    const double spacing = core::median_spacing_radians(lights);
    const std::vector<Vec3> axes{{0, 0, 1}, {1, 0, 0}, {0.3, -0.5, 0.2}, core::cross(lights[0].vec(), {0.2, 0.3, 0.5})};
    for (const Vec3 axis : axes) {
      const Vec3 start = core::cross(axis, Vec3{0.1, 0.2, 1});
      const auto at = [&](double turn) { return Direction::from_vector(core::rotation_about(axis, turn) * start); };
      // A jump does not shrink with the step.
      constexpr int kSteps = 400;
      for (int i = 0; i < kSteps; ++i) {
        double from = 2 * std::numbers::pi * i / kSteps, to = 2 * std::numbers::pi * (i + 1) / kSteps;
        auto before = method->linear_weights(at(from)), after = method->linear_weights(at(to));
        // Towards where the step is steepest.
        while (to - from > 1e-9) {
          const double middle = (from + to) / 2;
          const auto between = method->linear_weights(at(middle));
          if (distance(before, between) > distance(between, after)) {
            to = middle;
            after = between;
          } else {
            from = middle;
            before = between;
          }
        }
        REQUIRE(distance(before, after) < 1e-7 + 1e-7 / std::min(spacing, 1.0));
      }
    }
  }
}

TEST_CASE("barycentric weights point at the query, and short of it by less than the triangle is high") {
  const std::vector<Direction> lights = core::geodesic_directions(162);
  const auto method = barycentric_over(lights);
  const double spacing = core::median_spacing_radians(lights);
  for (const Direction& query : core::random_directions(200, 6)) {
    const auto weights = method->linear_weights(query);
    Vec3 mean;
    std::size_t used = 0;
    for (std::size_t i = 0; i < lights.size(); ++i) {
      mean = mean + weights[i] * lights[i].vec();
      used += weights[i] != 0 ? 1 : 0;
    }
    CHECK(used <= 3);
    CHECK(core::norm(core::cross(mean, query.vec())) < 1e-12);
    CHECK(core::norm(mean) <= 1 + 1e-12);
    CHECK(core::norm(mean) > 1 - 0.5 * std::pow(0.75 * spacing, 2));
  }
}

TEST_CASE("barycentric weights are those of the triangle that contains the query, found the plain way") {
  // Cocircular lights are left out: their square has two triangulations.
  const std::vector<Direction> lights = core::random_directions(60, 12);
  const auto method = barycentric_over(lights);
  std::size_t found = 0;
  for (const Direction& query : core::random_directions(100, 13)) {
    // The only three lights around the query whose circle holds no other light.
    for (std::size_t a = 0; a < lights.size(); ++a)
      for (std::size_t b = a + 1; b < lights.size(); ++b)
        for (std::size_t c = b + 1; c < lights.size(); ++c) {
          const Vec3 A = lights[a].vec(), B = lights[b].vec(), C = lights[c].vec(), q = query.vec();
          const double whole = core::dot(A, core::cross(B, C));
          const double wa = core::dot(q, core::cross(B, C)) / whole, wb = core::dot(A, core::cross(q, C)) / whole,
                       wc = core::dot(A, core::cross(B, q)) / whole;
          if (wa < 0 || wb < 0 || wc < 0) continue;
          Vec3 normal = core::cross(B - A, C - A);
          normal = (whole > 0 ? 1 : -1) / core::norm(normal) * normal;
          const double height = core::dot(normal, A);
          if (height < 0.75) continue;  // wide ones may be holes
          if (std::any_of(lights.begin(), lights.end(),
                          [&](const Direction& d) { return core::dot(normal, d.vec()) > height + 1e-12; }))
            continue;
          const auto weights = method->linear_weights(query);
          CHECK(weights[a] == Approx(wa / (wa + wb + wc)).margin(1e-12));
          CHECK(weights[b] == Approx(wb / (wa + wb + wc)).margin(1e-12));
          CHECK(weights[c] == Approx(wc / (wa + wb + wc)).margin(1e-12));
          ++found;
        }
  }
  CHECK(found > 80);
}

TEST_CASE("the open side of a dome takes its light from the rim, and triangles of the dome stay as they are") {
  const std::vector<Direction> lights = dome(0, 9, 24, true);
  const auto method = barycentric_over(lights);
  const auto below = method->linear_weights(Direction::from_vector({0, -1, 0}));
  double rim = 0, widest = 0;
  for (std::size_t i = 0; i < lights.size(); ++i) {
    if (lights[i].latitude_degrees() < 1e-9) {
      rim += below[i];
      widest = std::max(widest, below[i]);
    }
  }
  CHECK(rim == Approx(1).epsilon(1e-9));
  CHECK(widest < 0.1);  // from all around, not from one light
  for (const Direction& query : core::random_directions(300, 8)) {
    if (query.latitude_degrees() < 1) continue;
    const auto weights = method->linear_weights(query);
    CHECK(std::count_if(weights.begin(), weights.end(), [](double w) { return w > 1e-12; }) <= 3);
    for (std::size_t i = 0; i < lights.size(); ++i)
      if (weights[i] > 1e-12) CHECK(core::degrees_from_radians(core::angle_radians(lights[i], query)) < 20);
  }
}

TEST_CASE("a single light, and lights in one place, are all that barycentric shows") {
  for (const auto& lights : {std::vector<Direction>(1), std::vector<Direction>(4)}) {
    const auto method = barycentric_over(lights);
    for (const Direction& query : core::random_directions(20, 3))
      for (const double w : method->linear_weights(query)) CHECK(w == Approx(1.0 / double(lights.size())));
  }
}

TEST_CASE("barycentric weights turn with the stage") {
  const std::vector<Direction> lights = core::random_directions(60, 8), there = turned(lights);
  const auto a = barycentric_over(lights), b = barycentric_over(there);
  const std::vector<Direction> queries = core::random_directions(50, 9), turned_queries = turned(queries);
  for (std::size_t q = 0; q < queries.size(); ++q)
    CHECK(distance(a->linear_weights(queries[q]), b->linear_weights(turned_queries[q])) < 1e-8);
}

TEST_CASE("many barycentric queries at once are the sum over each, on every number of threads") {
  std::vector<Direction> with_twin = core::random_directions(50, 3);
  with_twin.push_back(with_twin[7]);
  for (const auto& lights : {dome(0, 7, 16, true), with_twin, ring(9, 20), std::vector<Direction>(2)}) {
    const auto method = barycentric_over(lights);
    // Far from each other, in rows as a map's pixels, and on the lights, on edges and at their antipodes.
    std::vector<Direction> queries = core::random_directions(300, 4);
    for (int i = 0; i < 400; ++i)
      queries.push_back(Direction::from_longitude_latitude_degrees(i, 20.0 * (i / 100) - 40));
    for (const Direction& light : lights) {
      queries.push_back(light);
      queries.push_back(Direction::from_vector(-1.0 * light.vec()));
      queries.push_back(Direction::from_vector(light.vec() + 0.7 * lights.front().vec()));
    }
    std::vector<model::DistantLight> shining;
    std::vector<Vec3> plain(lights.size());
    for (const Direction& query : queries) {
      shining.push_back({query, {1, double(shining.size() % 5), 1e6}});
      const std::vector<double> weights = method->linear_weights(query);
      for (std::size_t i = 0; i < plain.size(); ++i) plain[i] = plain[i] + weights[i] * shining.back().irradiance;
    }
    const std::vector<Vec3> fast = method->captured_colours(shining);
    REQUIRE(fast.size() == lights.size());
    for (std::size_t i = 0; i < plain.size(); ++i) {
      CHECK(fast[i].x == Approx(plain[i].x).margin(1e-9));
      CHECK(fast[i].y == Approx(plain[i].y).margin(1e-9));
      CHECK(fast[i].z == Approx(plain[i].z).margin(1e-3));
    }
    for (const int threads : {1, 3}) {
      core::set_thread_count(threads);
      CHECK(method->captured_colours(shining) == fast);
    }
    core::set_thread_count(0);
    for (const Vec3 colour : method->captured_colours({})) CHECK(colour == Vec3{});
  }
}

}  // namespace lightstage
