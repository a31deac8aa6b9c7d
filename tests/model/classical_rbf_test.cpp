// The weights of thin-plate interpolation, through the public interface.
#include <array>
#include <catch2/catch.hpp>
#include <numbers>

#include "core/error.h"
#include "core/light_list.h"
#include "core/parallel.h"
#include "core/sphere.h"
#include "model/classical.h"
#include "model/synthetic_scan.h"
#include "model/weight_sums.h"
#include "support/support.h"

namespace lightstage {

namespace {

using core::Direction;
using core::Vec3;
using test::sum_of, test::weighted_sum;

std::unique_ptr<model::LightInterpolator> rbf_over(const std::vector<Direction>& lights,
                                                   const model::RadialBasis& basis = {}) {
  return model::make_rbf(test::scan_of(lights, {1, 1, 1}, [](auto&&...) { return 1.0; }), model::Domain::kLinear,
                         basis);
}

// Interpolates in the plain way: solves for the coefficients of the interpolant by elimination in long
// double, then evaluates it.
class PlainRadialBasis {
 public:
  PlainRadialBasis(const std::vector<Direction>& lights, const std::vector<double>& values,
                   model::RadialKernel kernel = model::RadialKernel::kThinPlate, double ridge = 0)
      : lights_(lights), kernel_(kernel) {
    const std::size_t n = lights.size();
    std::vector<std::vector<long double>> m(n + 4, std::vector<long double>(n + 5, 0));
    for (std::size_t i = 0; i < n; ++i) {
      const std::vector<long double> row = terms(lights[i]);
      for (std::size_t j = 0; j < n + 4; ++j) m[i][j] = row[j];
      for (std::size_t j = n; j < n + 4; ++j) m[j][i] = row[j];
      m[i][i] += ridge;
      m[i][n + 4] = values[i];
    }
    for (std::size_t k = 0; k < n + 4; ++k) {
      std::size_t pivot = k;
      for (std::size_t i = k; i < n + 4; ++i)
        if (std::fabs(m[i][k]) > std::fabs(m[pivot][k])) pivot = i;
      std::swap(m[k], m[pivot]);
      for (std::size_t i = 0; i < n + 4; ++i) {
        if (i == k) continue;
        const long double factor = m[i][k] / m[k][k];
        for (std::size_t j = k; j < n + 5; ++j) m[i][j] -= factor * m[k][j];
      }
    }
    for (std::size_t k = 0; k < n + 4; ++k) coefficients_.push_back(m[k][n + 4] / m[k][k]);
  }

  double at(const Direction& query) const {
    const std::vector<long double> row = terms(query);
    long double sum = 0;
    for (std::size_t k = 0; k < row.size(); ++k) sum += coefficients_[k] * row[k];
    return double(sum);
  }

 private:
  std::vector<long double> terms(const Direction& q) const {
    std::vector<long double> row;
    for (const Direction& light : lights_) {
      const long double r = core::norm(q.vec() - light.vec());
      row.push_back(r > 0 ? (kernel_ == model::RadialKernel::kLinear ? -r : r * r * std::log(r)) : 0);
    }
    for (const double t : {1.0, q.x(), q.y(), q.z()}) row.push_back(t);
    return row;
  }
  std::vector<Direction> lights_;
  model::RadialKernel kernel_;
  std::vector<long double> coefficients_;
};

void require_one_hot_at_lights(const std::vector<Direction>& lights,
                               model::RadialKernel kernel = model::RadialKernel::kThinPlate) {
  const auto rbf = rbf_over(lights, {kernel, 0});
  double worst = 0;
  for (std::size_t i = 0; i < lights.size(); ++i) {
    // A hair beside the light, where the general path is taken, and on it.
    const Direction beside = Direction::from_vector(lights[i].vec() + Vec3{1e-11, -1e-11, 1e-11});
    const std::vector<double> weights = rbf->linear_weights(beside);
    for (std::size_t j = 0; j < lights.size(); ++j) worst = std::max(worst, std::abs(weights[j] - (i == j ? 1 : 0)));
    const std::vector<double> exact = rbf->linear_weights(lights[i]);
    for (std::size_t j = 0; j < lights.size(); ++j) REQUIRE(exact[j] == (i == j ? 1 : 0));
  }
  CHECK(worst < 1e-9);
}

}  // namespace

TEST_CASE("rbf weights are 1 at a light and 0 elsewhere, on stages of every size") {
  for (const std::size_t n : {5u, 12u, 96u, 331u}) require_one_hot_at_lights(core::fibonacci_directions(n));
  require_one_hot_at_lights(core::fibonacci_directions(96), model::RadialKernel::kLinear);
}

TEST_CASE("rbf weights are 1 at a light and 0 elsewhere on a real stage") {
  const auto path = test::real_data("stages/lightstage_331.lp");
  if (path.empty()) SKIP_TEST("no stage layout here");
  std::vector<Direction> lights;
  for (const core::LpEntry& entry : core::read_lp(path)) lights.push_back(entry.direction);
  require_one_hot_at_lights(lights);
}

TEST_CASE("rbf weights give what solving for the coefficients gives") {
  const std::vector<Direction> lights = core::random_directions(40, 3);
  std::vector<double> values;
  for (std::size_t i = 0; i < lights.size(); ++i) values.push_back(std::sin(double(7 * i)));
  const PlainRadialBasis plain(lights, values);
  const auto rbf = rbf_over(lights);
  for (const Direction& query : core::random_directions(50, 4)) {
    const std::vector<double> weights = rbf->linear_weights(query);
    double fast = 0;
    for (std::size_t i = 0; i < lights.size(); ++i) fast += weights[i] * values[i];
    CHECK(fast == Approx(plain.at(query)).margin(1e-9));
  }
}

TEST_CASE("rbf reproduces every linear function of the light's position, so its weights sum to 1") {
  const std::vector<Direction> lights = core::fibonacci_directions(150);
  const auto rbf = rbf_over(lights);
  const auto f = [](Vec3 v) { return 2 - 3 * v.x + 5 * v.y + 0.5 * v.z; };
  for (const Direction& query : core::random_directions(100, 5)) {
    const std::vector<double> weights = rbf->linear_weights(query);
    CHECK(sum_of(weights) == Approx(1).margin(1e-9));
    double value = 0;
    for (std::size_t i = 0; i < lights.size(); ++i) value += weights[i] * f(lights[i].vec());
    CHECK(value == Approx(f(query.vec())).margin(1e-9));
  }
}

TEST_CASE("rbf weights turn with the stage") {
  const core::Mat3 turn = core::rotation_about({1, 2, -1}, 0.7);
  const std::vector<Direction> lights = core::random_directions(60, 8);
  std::vector<Direction> turned;
  for (const Direction& d : lights) turned.push_back(Direction::from_vector(turn * d.vec()));
  const auto here = rbf_over(lights), there = rbf_over(turned);
  for (const Direction& query : core::random_directions(20, 9)) {
    const auto a = here->linear_weights(query);
    const auto b = there->linear_weights(Direction::from_vector(turn * query.vec()));
    for (std::size_t i = 0; i < a.size(); ++i) CHECK(a[i] == Approx(b[i]).margin(1e-9));
  }
}

TEST_CASE("lights in the same place share their rbf weight equally") {
  std::vector<Direction> lights = core::fibonacci_directions(30);
  const auto alone = rbf_over(lights);
  const Direction twin = Direction::from_vector(lights[7].vec() + Vec3{0, 1e-5, 0});
  lights.push_back(lights[7]);
  lights.push_back(twin);
  const auto shared = rbf_over(lights);
  for (const Direction& query : core::random_directions(20, 10)) {
    const auto a = alone->linear_weights(query);
    const auto b = shared->linear_weights(query);
    REQUIRE(b.size() == 32);
    for (std::size_t i = 0; i < 30; ++i) CHECK(b[i] == Approx(i == 7 ? a[i] / 3 : a[i]).margin(1e-12));
    CHECK(b[30] == b[7]);
    CHECK(b[31] == b[7]);
  }
}

TEST_CASE("the rbf colours of many lights at once are the sum over them one by one, on every thread count") {
  std::vector<Direction> lights = core::fibonacci_directions(80);
  lights.push_back(lights[3]);
  const auto rbf = rbf_over(lights);
  for (const std::size_t count : {0u, 1u, 63u, 64u, 65u, 1000u}) {
    std::vector<model::DistantLight> queries;
    std::vector<Vec3> plain(lights.size());
    for (const Direction& query : core::random_directions(count, 20)) {
      queries.push_back({queries.size() == 5 ? lights[9] : query, {1, double(queries.size() % 7), 1e6 * query.x()}});
      const std::vector<double> weights = rbf->linear_weights(queries.back().direction);
      for (std::size_t i = 0; i < plain.size(); ++i) plain[i] = plain[i] + weights[i] * queries.back().irradiance;
    }
    const std::vector<Vec3> fast = rbf->captured_colours(queries);
    REQUIRE(fast.size() == lights.size());
    for (std::size_t i = 0; i < plain.size(); ++i) {
      CHECK(fast[i].x == Approx(plain[i].x).margin(1e-8));
      CHECK(fast[i].y == Approx(plain[i].y).margin(1e-8));
      CHECK(fast[i].z == Approx(plain[i].z).margin(1e-3));
    }
    for (const int threads : {1, 2, 7}) {
      core::set_thread_count(threads);
      CHECK(rbf->captured_colours(queries) == fast);
    }
    core::set_thread_count(0);
  }
}

TEST_CASE("few lights, a ring and one place leave an rbf of lower order that still interpolates") {
  const auto ring = [](std::size_t n, double latitude, double noise) {
    std::vector<Direction> lights;
    for (std::size_t i = 0; i < n; ++i)
      lights.push_back(Direction::from_longitude_latitude_degrees(360.0 * double(i) / double(n),
                                                                  latitude + noise * std::sin(double(i * i))));
    return lights;
  };
  std::vector<std::vector<Direction>> layouts;
  for (const std::size_t n : {1u, 2u, 3u, 4u}) layouts.push_back(core::random_directions(n, n));
  layouts.push_back({Direction(), Direction::from_vector({0, 0, -1})});  // opposite
  layouts.push_back(std::vector<Direction>(5));                          // all in one place
  layouts.push_back(ring(24, 0, 0));
  layouts.push_back(ring(24, 40, 0));
  layouts.push_back(ring(24, 40, 0.01));  // as calibrated: off the plane by hundredths of a degree
  for (const std::vector<Direction>& lights : layouts) {
    CAPTURE(lights.size());
    const auto rbf = rbf_over(lights);
    for (const Direction& query : core::random_directions(30, 11)) {
      const std::vector<double> weights = rbf->linear_weights(query);
      CHECK(sum_of(weights) == Approx(1).margin(1e-9));
      for (const double w : weights) CHECK(std::abs(w) < 50);
    }
    for (const Direction& light : lights) {
      const std::vector<double> weights = rbf->linear_weights(light);
      double nearest = 0;
      for (std::size_t i = 0; i < lights.size(); ++i)
        if (lights[i] == light) nearest += weights[i];
      CHECK(nearest == Approx(1).margin(1e-9));
    }
  }
}

TEST_CASE("the rbf weights of lights a thousandth of a degree over the merging distance stay finite and sum to 1") {
  std::vector<Direction> lights = core::fibonacci_directions(100);
  lights.push_back(Direction::from_vector(lights[50].vec() + Vec3{0, 0, 2e-4}));
  const auto rbf = rbf_over(lights);
  for (const Direction& query : core::random_directions(30, 12)) {
    const auto weights = rbf->linear_weights(query);
    for (const double w : weights) REQUIRE(std::isfinite(w));
    CHECK(sum_of(weights) == Approx(1).margin(1e-7));
  }
}

TEST_CASE("rbf refuses more lights than a dense system can hold") {
  CHECK_THROWS_AS(rbf_over(core::fibonacci_directions(8001)), core::UsageError);
}

TEST_CASE("the linear kernel gives what solving for the coefficients gives, and sums to 1") {
  const std::vector<Direction> lights = core::random_directions(40, 3);
  std::vector<double> values;
  for (std::size_t i = 0; i < lights.size(); ++i) values.push_back(std::sin(double(7 * i)));
  const PlainRadialBasis plain(lights, values, model::RadialKernel::kLinear);
  const auto rbf = rbf_over(lights, {model::RadialKernel::kLinear, 0});
  const auto thin_plate = rbf_over(lights);
  double apart = 0;
  for (const Direction& query : core::random_directions(50, 4)) {
    const std::vector<double> weights = rbf->linear_weights(query);
    CHECK(weighted_sum(weights, values) == Approx(plain.at(query)).margin(1e-9));
    CHECK(sum_of(weights) == Approx(1).margin(1e-9));
    apart = std::max(apart,
                     std::abs(weighted_sum(weights, values) - weighted_sum(thin_plate->linear_weights(query), values)));
  }
  CHECK(apart > 1e-3);
}

TEST_CASE(
    "smoothing adds its part of the kernel's trace to the diagonal, and lights in one place count as often as they "
    "are") {
  for (const auto kernel : {model::RadialKernel::kThinPlate, model::RadialKernel::kLinear}) {
    const std::vector<Direction> lights = core::random_directions(30, 3);
    std::vector<double> values;
    for (std::size_t i = 0; i < lights.size(); ++i) values.push_back(std::sin(double(7 * i)));
    // The trace on what is perpendicular to 1, x, y and z, one unit vector at a time.
    const std::size_t n = lights.size();
    std::vector<std::vector<double>> polynomial;
    const auto without_polynomial = [&](std::vector<double> v) {
      for (int twice = 0; twice < 2; ++twice)
        for (const auto& p : polynomial) {
          const double along = weighted_sum(v, p);
          for (std::size_t i = 0; i < n; ++i) v[i] -= along * p[i];
        }
      return v;
    };
    for (int term = 0; term < 4; ++term) {
      std::vector<double> p;
      for (const Direction& light : lights)
        p.push_back(term == 0 ? 1 : term == 1 ? light.x() : term == 2 ? light.y() : light.z());
      p = without_polynomial(p);
      const double length = std::sqrt(weighted_sum(p, p));
      for (double& v : p) v /= length;
      polynomial.push_back(p);
    }
    double trace = 0;
    for (std::size_t k = 0; k < n; ++k) {
      std::vector<double> v(n, 0.0);
      v[k] = 1;
      v = without_polynomial(v);
      for (std::size_t i = 0; i < n; ++i)
        for (std::size_t j = 0; j < n; ++j) {
          const double r = core::norm(lights[i].vec() - lights[j].vec());
          if (i != j) trace += v[i] * v[j] * (kernel == model::RadialKernel::kLinear ? -r : r * r * std::log(r));
        }
    }
    REQUIRE(trace > 0);
    for (const double smoothing : {1e-4, 0.1}) {
      const PlainRadialBasis plain(lights, values, kernel, smoothing * trace);
      const auto rbf = rbf_over(lights, {kernel, smoothing});
      for (const Direction& query : core::random_directions(20, 4))
        CHECK(weighted_sum(rbf->linear_weights(query), values) == Approx(plain.at(query)).margin(1e-8));
    }
    // Every light twice: the trace, of distinct places, is the same, and each place counts twice.
    std::vector<Direction> twice = lights;
    twice.insert(twice.end(), lights.begin(), lights.end());
    const auto doubled = rbf_over(twice, {kernel, 0.2}), single = rbf_over(lights, {kernel, 0.1});
    for (const Direction& query : core::random_directions(10, 5)) {
      const auto a = doubled->linear_weights(query), b = single->linear_weights(query);
      for (std::size_t i = 0; i < n; ++i) CHECK(a[i] + a[i + n] == Approx(b[i]).margin(1e-10));
    }
  }
}

TEST_CASE("much smoothing leaves the least-squares plane, and more of it less of the noise") {
  const std::vector<Direction> lights = core::fibonacci_directions(80);
  // A plane, and something perpendicular to it in the sense of least squares.
  const auto plane = [](const Direction& d) { return 1 + 2 * d.x() - d.y() + 0.5 * d.z(); };
  std::vector<double> values, rest;
  for (std::size_t i = 0; i < lights.size(); ++i) rest.push_back(std::sin(double(11 * i)));
  const auto fitted = rbf_over(lights, {model::RadialKernel::kThinPlate, 1e6});
  std::vector<double> fit;
  for (const Direction& light : lights) fit.push_back(weighted_sum(fitted->linear_weights(light), rest));
  std::array<double, 4> moments{}, left{};
  for (std::size_t i = 0; i < lights.size(); ++i) {
    const std::array<double, 4> terms{1, lights[i].x(), lights[i].y(), lights[i].z()};
    for (std::size_t t = 0; t < 4; ++t) {
      moments[t] += rest[i] * terms[t];
      left[t] += (rest[i] - fit[i]) * terms[t];
    }
    values.push_back(plane(lights[i]) + rest[i] - fit[i]);
  }
  for (std::size_t t = 0; t < 4; ++t) CHECK(std::abs(left[t]) < 1e-4 * (1 + std::abs(moments[t])));  // normal equations
  for (const auto kernel : {model::RadialKernel::kThinPlate, model::RadialKernel::kLinear}) {
    const auto rbf = rbf_over(lights, {kernel, 1e6});
    for (const Direction& query : core::random_directions(50, 6))
      CHECK(weighted_sum(rbf->linear_weights(query), values) == Approx(plane(query)).margin(1e-4));
  }
  double last = INFINITY;
  for (const double smoothing : {0.0, 1e-5, 1e-3, 1e-1}) {
    const auto rbf = rbf_over(lights, {model::RadialKernel::kThinPlate, smoothing});
    double noise = 0;  // the variance of the picture under pixel noise of variance 1
    for (const Direction& query : core::random_directions(100, 7)) {
      const auto weights = rbf->linear_weights(query);
      noise += weighted_sum(weights, weights);
    }
    CHECK(noise < last);
    last = noise;
  }
}

TEST_CASE("a smoothing does the same to a smooth function whatever the number of lights") {
  const auto f = [](const Direction& d) { return d.x() * d.x() - d.y() * d.z(); };
  std::vector<double> kept;
  for (const std::size_t n : {100u, 200u, 400u}) {
    const std::vector<Direction> lights = core::fibonacci_directions(n);
    std::vector<double> values;
    for (const Direction& light : lights) values.push_back(f(light));
    const auto rbf = rbf_over(lights, {model::RadialKernel::kThinPlate, 0.05});
    double along = 0, whole = 0;
    for (const Direction& query : core::random_directions(200, 7)) {
      along += weighted_sum(rbf->linear_weights(query), values) * f(query);
      whole += f(query) * f(query);
    }
    kept.push_back(along / whole);
  }
  CHECK(kept[0] < 0.95);
  CHECK(kept[1] == Approx(kept[0]).epsilon(0.03));
  CHECK(kept[2] == Approx(kept[0]).epsilon(0.03));
}

TEST_CASE("few and coplanar lights can be smoothed, and a smoothing that is no number is refused") {
  std::vector<Direction> ring;
  for (int i = 0; i < 24; ++i) ring.push_back(Direction::from_longitude_latitude_degrees(15.0 * i, 40));
  std::vector<std::vector<Direction>> layouts{ring, std::vector<Direction>(5)};
  for (const std::size_t n : {1u, 2u, 3u, 4u, 5u}) layouts.push_back(core::random_directions(n, n));
  for (const auto& lights : layouts)
    for (const auto kernel : {model::RadialKernel::kThinPlate, model::RadialKernel::kLinear})
      for (const double smoothing : {1e-9, 1.0, 1e6}) {
        const auto rbf = rbf_over(lights, {kernel, smoothing});
        for (const Direction& query : core::random_directions(20, 11))
          CHECK(sum_of(rbf->linear_weights(query)) == Approx(1).margin(1e-6));
      }
  for (const double bad : {-1.0, double(NAN), double(INFINITY)})
    CHECK_THROWS_AS(rbf_over(ring, {model::RadialKernel::kThinPlate, bad}), core::UsageError);
}

}  // namespace lightstage
