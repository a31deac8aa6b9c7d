// Multilevel B-splines: the weights against the plain way, a pixel at a time.
#include <array>
#include <catch2/catch.hpp>
#include <cmath>
#include <map>
#include <numbers>

#include "core/parallel.h"
#include "core/sphere.h"
#include "model/classical.h"
#include "model/synthetic_scan.h"
#include "model/weight_sums.h"

namespace lightstage {

namespace {

using core::Direction;
using core::Vec3;
using test::sum_of, test::weighted_sum;

std::unique_ptr<model::LightInterpolator> bspline_over(const std::vector<Direction>& lights) {
  return model::make_bspline(test::scan_of(lights, {1, 1, 1}, [](auto&&...) { return 1.0; }), model::Domain::kLinear);
}

// The cubic B-spline around 0 by its recurrence (de Boor 1978): knots at -2 .. 2.
double spline(double x, int degree = 3) {
  const auto basis = [](auto&& self, double t, int d, int knot) -> double {
    if (d == 0) return t >= knot && t < knot + 1 ? 1 : 0;
    return (t - knot) / d * self(self, t, d - 1, knot) + (knot + d + 1 - t) / d * self(self, t, d - 1, knot + 1);
  };
  return basis(basis, x + 2, degree, 0);
}

// One pixel's function of the light: lattices of values, each fitted to what the ones before it left.
class PlainBSpline {
 public:
  PlainBSpline(const std::vector<Direction>& lights, const std::vector<double>& values, int levels) {
    fit_plane(lights, values);
    std::vector<double> rest = values;
    for (std::size_t c = 0; c < lights.size(); ++c) rest[c] -= plane(lights[c].vec());
    for (int level = 0; level < levels; ++level) {
      std::map<Place, double> above, below;
      for (std::size_t c = 0; c < lights.size(); ++c) {
        const std::map<Place, double> at = splines(lights[c].vec(), 1 << level);
        double squares = 0;
        for (const auto& [place, b] : at) squares += b * b;
        for (const auto& [place, b] : at) {
          above[place] += b * b * (b * rest[c] / squares);
          below[place] += b * b;
        }
      }
      std::map<Place, double>& lattice = lattices_.emplace_back();
      for (const auto& [place, value] : above) lattice[place] = below[place] > 0 ? value / below[place] : 0;
      for (std::size_t c = 0; c < lights.size(); ++c) rest[c] -= of_level(lights[c].vec(), level);
    }
  }

  double at(const Direction& query) const {
    double sum = plane(query.vec());
    for (int level = 0; level < int(lattices_.size()); ++level) sum += of_level(query.vec(), level);
    return sum;
  }

 private:
  using Place = std::array<int, 3>;

  static std::map<Place, double> splines(Vec3 v, int cells) {
    std::map<Place, double> at;
    const std::array<double, 3> t{(v.x + 1) / 2 * cells, (v.y + 1) / 2 * cells, (v.z + 1) / 2 * cells};
    const auto first = [](double u) { return int(std::floor(u)) - 1; };
    for (int i = first(t[0]); i < first(t[0]) + 4; ++i)
      for (int j = first(t[1]); j < first(t[1]) + 4; ++j)
        for (int k = first(t[2]); k < first(t[2]) + 4; ++k)
          at[{i, j, k}] = spline(t[0] - i) * spline(t[1] - j) * spline(t[2] - k);
    return at;
  }

  double of_level(Vec3 v, int level) const {
    double sum = 0;
    for (const auto& [place, b] : splines(v, 1 << level))
      if (const auto found = lattices_[std::size_t(level)].find(place); found != lattices_[std::size_t(level)].end())
        sum += b * found->second;
    return sum;
  }

  // Least squares over 1, x, y, z by the normal equations.
  void fit_plane(const std::vector<Direction>& lights, const std::vector<double>& values) {
    std::array<std::array<long double, 5>, 4> m{};
    for (std::size_t c = 0; c < lights.size(); ++c) {
      const std::array<long double, 5> row{1, lights[c].x(), lights[c].y(), lights[c].z(), values[c]};
      for (std::size_t i = 0; i < 4; ++i)
        for (std::size_t j = 0; j < 5; ++j) m[i][j] += row[i] * row[j];
    }
    for (std::size_t k = 0; k < 4; ++k)
      for (std::size_t i = 0; i < 4; ++i) {
        if (i == k) continue;
        const long double factor = m[i][k] / m[k][k];
        for (std::size_t j = 0; j < 5; ++j) m[i][j] -= factor * m[k][j];
      }
    for (std::size_t k = 0; k < 4; ++k) plane_[k] = double(m[k][4] / m[k][k]);
  }
  double plane(Vec3 v) const { return plane_[0] + plane_[1] * v.x + plane_[2] * v.y + plane_[3] * v.z; }

  std::array<double, 4> plane_{};
  std::vector<std::map<Place, double>> lattices_;
};

}  // namespace

TEST_CASE("bspline weights give what fitting lattices to a pixel's values gives") {
  for (const std::size_t n : {25u, 80u}) {
    const std::vector<Direction> lights = core::random_directions(n, 3);
    std::vector<double> values;
    for (std::size_t i = 0; i < n; ++i) values.push_back(std::sin(double(7 * i)) * (i == 5 ? 1e5 : 1));
    const auto bspline = bspline_over(lights);
    // More levels than needed change nothing: nothing is left after the one where no two lights share a spline.
    const PlainBSpline plain(lights, values, 12);
    for (const Direction& query : core::random_directions(20, 4)) {
      const double fast = weighted_sum(bspline->linear_weights(query), values);
      CHECK(fast == Approx(plain.at(query)).epsilon(1e-9).margin(1e-6));
    }
  }
}

TEST_CASE("bspline weights are 1 at a light and 0 elsewhere, on it and beside it") {
  for (const std::size_t n : {1u, 2u, 3u, 4u, 12u, 96u, 302u}) {
    std::vector<Direction> lights = core::fibonacci_directions(n);
    lights.push_back(Direction::from_vector({1, 0, 0}));  // on the faces of the lattice's cells
    lights.push_back(Direction::from_vector({0, 0, -1}));
    const auto bspline = bspline_over(lights);
    double worst = 0;
    for (std::size_t i = 0; i < lights.size(); ++i) {
      const auto exact = bspline->linear_weights(lights[i]);
      const auto beside = bspline->linear_weights(Direction::from_vector(lights[i].vec() + Vec3{1e-11, -1e-11, 1e-11}));
      for (std::size_t j = 0; j < lights.size(); ++j) {
        CHECK(exact[j] == (i == j ? 1 : 0));
        worst = std::max(worst, std::abs(beside[j] - exact[j]));
      }
    }
    CHECK(worst < 1e-8);
  }
}

TEST_CASE("bspline reproduces every linear function of the light's position, so its weights sum to 1") {
  const std::vector<Direction> lights = core::fibonacci_directions(150);
  const auto bspline = bspline_over(lights);
  const auto f = [](Vec3 v) { return 2 - 3 * v.x + 5 * v.y + 0.5 * v.z; };
  std::vector<double> values;
  for (const Direction& light : lights) values.push_back(f(light.vec()));
  for (const Direction& query : core::random_directions(100, 5)) {
    const std::vector<double> weights = bspline->linear_weights(query);
    CHECK(sum_of(weights) == Approx(1).margin(1e-10));
    CHECK(weighted_sum(weights, values) == Approx(f(query.vec())).margin(1e-10));
  }
}

TEST_CASE("bspline weights and their slopes are continuous along arcs through poles, cell faces, holes and lights") {
  std::vector<Direction> lights;
  for (const Direction& d : core::fibonacci_directions(150))
    if (d.y() > -0.3) lights.push_back(d);
  const auto bspline = bspline_over(lights);
  for (const Vec3 axis : {Vec3{0, 0, 1}, Vec3{1, 0, 0}, Vec3{0.3, -0.5, 0.2}}) {
    const Vec3 start = core::cross(axis, lights[20].vec());
    const auto at = [&](double turn) {
      return bspline->linear_weights(Direction::from_vector(core::rotation_about(axis, turn) * start));
    };
    // Of a function with two derivatives the second difference is of the step's square.
    for (const double step : {1e-3, 1e-4}) {
      double largest = 0;
      for (int i = 0; i < 600; ++i) {
        const double middle = 2 * std::numbers::pi * i / 600;
        const auto before = at(middle - step), here = at(middle), after = at(middle + step);
        for (std::size_t k = 0; k < here.size(); ++k)
          largest = std::max(largest, std::abs(before[k] - 2 * here[k] + after[k]));
      }
      CHECK(largest < 3000 * step * step);
    }
  }
}

TEST_CASE("few lights, rings, twins and holes leave bspline weights that are bounded and sum to 1") {
  std::vector<std::vector<Direction>> layouts;
  for (const std::size_t n : {1u, 2u, 3u, 4u}) layouts.push_back(core::random_directions(n, n));
  layouts.push_back({Direction(), Direction::from_vector({0, 0, -1})});
  layouts.push_back(std::vector<Direction>(5));
  std::vector<Direction> ring, dome, twins = core::fibonacci_directions(40);
  for (int i = 0; i < 24; ++i) ring.push_back(Direction::from_longitude_latitude_degrees(15.0 * i, 40));
  for (const Direction& d : core::fibonacci_directions(200))
    if (d.y() > 0.1) dome.push_back(d);
  twins.push_back(twins[7]);
  twins.push_back(Direction::from_vector(twins[8].vec() + Vec3{0, 1.5e-4, 0}));
  layouts.insert(layouts.end(), {ring, dome, twins});
  for (const std::vector<Direction>& lights : layouts) {
    CAPTURE(lights.size());
    const auto bspline = bspline_over(lights);
    std::vector<Direction> queries = core::random_directions(60, 11);
    for (const Direction& light : lights) queries.push_back(Direction::from_vector(-light.vec()));
    for (const Direction& query : queries) {
      const std::vector<double> weights = bspline->linear_weights(query);
      CHECK(sum_of(weights) == Approx(1).margin(1e-9));
      for (const double w : weights) CHECK(std::abs(w) < 50);
    }
  }
  const auto shared = bspline_over(twins);
  const auto weights = shared->linear_weights(Direction::from_vector({0.2, 0.3, 0.4}));
  CHECK(weights[40] == weights[7]);
}

TEST_CASE("the bspline colours of many lights at once are the sum over them one by one, on every thread count") {
  const std::vector<Direction> lights = core::fibonacci_directions(60);
  const auto bspline = bspline_over(lights);
  std::vector<model::DistantLight> queries;
  std::vector<Vec3> plain(lights.size());
  for (const Direction& query : core::random_directions(200, 20)) {
    queries.push_back({queries.size() == 5 ? lights[9] : query, {1, double(queries.size() % 7), 100 * query.x()}});
    const std::vector<double> weights = bspline->linear_weights(queries.back().direction);
    for (std::size_t i = 0; i < plain.size(); ++i) plain[i] = plain[i] + weights[i] * queries.back().irradiance;
  }
  const std::vector<Vec3> fast = bspline->captured_colours(queries);
  REQUIRE(fast.size() == lights.size());
  for (std::size_t i = 0; i < plain.size(); ++i) CHECK(core::norm(fast[i] - plain[i]) < 1e-8);
  for (const int threads : {1, 2, 7}) {
    core::set_thread_count(threads);
    CHECK(bspline->captured_colours(queries) == fast);
  }
  core::set_thread_count(0);
}

}  // namespace lightstage
