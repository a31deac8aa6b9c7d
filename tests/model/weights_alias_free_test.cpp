// Alias-free weights against the published formula evaluated in long double, and at every limit of it.
#include <catch2/catch.hpp>
#include <limits>
#include <numeric>

#include "core/error.h"
#include "core/sphere.h"
#include "model/alias_free_weights.h"

namespace lightstage {
namespace {

using core::Direction;
using Lights = std::vector<Direction>;

// As published, with the largest exponent taken out; s > 0.
std::vector<long double> reference(const Direction& q, const Lights& lights, long double s) {
  std::vector<long double> a, w;
  for (const Direction& l : lights) {
    const long double x = static_cast<long double>(q.x()) - l.x(), y = static_cast<long double>(q.y()) - l.y(),
                      z = static_cast<long double>(q.z()) - l.z();
    a.push_back((x * x + y * y + z * z) / 2);
  }
  const long double nearest = *std::min_element(a.begin(), a.end());
  for (const long double d : a) w.push_back(std::exp(-s * (d - nearest)));
  const long double farthest = *std::min_element(w.begin(), w.end());
  long double sum = 0;
  for (long double& v : w) sum += v = std::max(0.0L, v - farthest);
  for (long double& v : w) v /= sum;
  return w;
}

Lights nearest(const Lights& stage, const Direction& query, std::size_t k) {
  Lights result;
  for (const std::size_t i : core::nearest_indices(stage, query, k)) result.push_back(stage[i]);
  return result;
}

double sum(const std::vector<double>& values) {
  return std::accumulate(values.begin(), values.end(), 0.0);
}

// The geometries that a stage meets: between lights, on one, far from all, opposite to all.
std::vector<std::pair<Direction, Lights>> geometries() {
  const Lights stage = core::fibonacci_directions(180);
  std::vector<std::pair<Direction, Lights>> result;
  for (const Direction& q : core::random_directions(20, 5)) result.emplace_back(q, nearest(stage, q, 8));
  result.emplace_back(stage[17], nearest(stage, stage[17], 8));
  const Direction pole = Direction::from_vector({0, 1, 0});
  Lights around;
  for (int i = 0; i < 8; ++i) around.push_back(Direction::from_longitude_latitude_degrees(45.0 * i, 50.0 - i));
  result.emplace_back(pole, around);  // the middle of a hole of 40 degrees
  const Direction opposite = Direction::from_vector(-nearest(stage, pole, 1).front().vec());
  result.emplace_back(opposite, nearest(stage, pole, 8));
  return result;
}

}  // namespace

TEST_CASE("alias-free weights equal the published formula for every sharpness") {
  for (const auto& [query, lights] : geometries()) {
    for (const double s : {1e-6, 1e-3, 0.1, 1.0, 20.0, 100.0, 1e3, 1e4, 1e6}) {
      const std::vector<long double> expected = reference(query, lights, s);
      const std::vector<double> actual = model::alias_free_weights(query, lights, s);
      REQUIRE(actual.size() == lights.size());
      CHECK(sum(actual) == Approx(1).margin(1e-12));
      for (std::size_t i = 0; i < lights.size(); ++i) {
        CHECK(actual[i] == Approx(double(expected[i])).margin(1e-9));
        CHECK(std::abs(static_cast<float>(actual[i]) - static_cast<float>(expected[i])) <= 1e-6f);
      }
    }
  }
}

TEST_CASE("alias-free weights at s = 0 are the limit of small s") {
  for (const auto& [query, lights] : geometries()) {
    const auto zero = model::alias_free_weights(query, lights, 0);
    const auto small = model::alias_free_weights(query, lights, 1e-7);
    for (std::size_t i = 0; i < lights.size(); ++i) CHECK(zero[i] == Approx(small[i]).margin(1e-6));
  }
}

TEST_CASE("the farthest light of an active set weighs exactly nothing") {
  for (const auto& [query, lights] : geometries()) {
    std::size_t farthest = 0;
    for (std::size_t i = 0; i < lights.size(); ++i) {
      if (angle_radians(query, lights[i]) > angle_radians(query, lights[farthest])) farthest = i;
    }
    for (const double s : {0.0, 1.0, 100.0, 1e6}) CHECK(model::alias_free_weights(query, lights, s)[farthest] == 0);
  }
}

TEST_CASE("lights equally far weigh the same") {
  for (const double latitude : {89.9, 60.0, 10.0, -80.0}) {
    Lights ring;
    for (int i = 0; i < 7; ++i) ring.push_back(Direction::from_longitude_latitude_degrees(360.0 / 7 * i, latitude));
    for (const double s : {0.0, 1.0, 100.0, 1e6}) {
      const auto w = model::sloped_alias_free_weights(Direction::from_vector({0, 1, 0}), ring, s);
      for (std::size_t i = 0; i < ring.size(); ++i) {
        CHECK(w.weights[i] == Approx(1.0 / 7).margin(1e-6));
        CHECK(std::abs(w.slopes[i]) < 1e-6);
      }
    }
  }
}

TEST_CASE("one light, and several in one place, share the weight") {
  const Direction q = Direction::from_vector({0.3, 0.2, 1});
  const Direction l = Direction::from_vector({0, 0, 1});
  for (const double s : {0.0, 50.0, 1e6}) {
    CHECK(model::alias_free_weights(q, Lights{l}, s) == std::vector<double>{1});
    CHECK(model::alias_free_weights(l, Lights{l}, s) == std::vector<double>{1});
    CHECK(model::alias_free_weights(q, Lights{l, l}, s) == std::vector<double>{0.5, 0.5});
    const auto twice = model::alias_free_weights(q, Lights{l, l, Direction::from_vector({0, -1, 0})}, s);
    CHECK(twice[0] == 0.5);
    CHECK(twice[1] == 0.5);
    CHECK(twice[2] == 0);
  }
}

TEST_CASE("the slopes of the weights are their derivatives by ln s") {
  for (const auto& [query, lights] : geometries()) {
    for (const double s : {1e-3, 1.0, 20.0, 100.0, 1e3, 1e4}) {
      const auto actual = model::sloped_alias_free_weights(query, lights, s);
      constexpr long double kStep = 1e-5L;
      const auto above = reference(query, lights, s * std::exp(kStep));
      const auto below = reference(query, lights, s * std::exp(-kStep));
      for (std::size_t i = 0; i < lights.size(); ++i) {
        CHECK(actual.slopes[i] == Approx(double((above[i] - below[i]) / (2 * kStep))).margin(1e-6));
      }
      CHECK(sum(actual.slopes) == Approx(0).margin(1e-9));
    }
  }
}

TEST_CASE("weights and slopes are finite at every extreme at once") {
  const Direction q = Direction::from_vector({0, 0, 1});
  const Direction close = Direction::from_vector({1e-9, 0, 1});
  const Direction opposite = Direction::from_vector({0, 0, -1});
  const std::vector<Lights> sets{{q}, {q, q}, {q, opposite}, {opposite, opposite}, {close, q, opposite}, {close, q}};
  for (const Lights& lights : sets) {
    for (const double s : {0.0, std::numeric_limits<double>::denorm_min(), 1e-300, 1e-9, 1.0, 1e6, 1e300}) {
      const auto w = model::sloped_alias_free_weights(q, lights, s);
      CHECK(sum(w.weights) == Approx(1).margin(1e-12));
      for (std::size_t i = 0; i < lights.size(); ++i) {
        CHECK(std::isfinite(w.weights[i]));
        CHECK(std::isfinite(w.slopes[i]));
        CHECK(w.weights[i] >= 0);
      }
    }
  }
}

TEST_CASE("weights change continuously where the active set changes") {
  const Lights stage = core::fibonacci_directions(180);
  // The weight of every light of the stage, and the largest change of one along a great circle of n steps.
  const auto all = [&](const Direction& q, bool alias_free) {
    const std::vector<std::size_t> active = core::nearest_indices(stage, q, 8);
    std::vector<double> w(stage.size(), 0.0);
    const std::vector<double> of_set = model::alias_free_weights(q, nearest(stage, q, 8), 60);
    for (std::size_t i = 0; i < active.size(); ++i) w[active[i]] = alias_free ? of_set[i] : 1.0 / 8;
    return w;
  };
  const auto largest_change = [&](int steps, bool alias_free) {
    double largest = 0;
    std::vector<double> before;
    for (int i = 0; i <= steps; ++i) {
      const double t = 0.5 + 1.0 * i / steps;
      const auto w = all(Direction::from_vector({std::cos(t), 0.4 * std::sin(3 * t), std::sin(t)}), alias_free);
      for (std::size_t j = 0; j < before.size(); ++j) largest = std::max(largest, std::abs(w[j] - before[j]));
      before = w;
    }
    return largest;
  };
  CHECK(largest_change(2000, true) < 0.01);
  CHECK(largest_change(20000, true) < 0.001);  // ten times finer steps, ten times smaller changes
  CHECK(largest_change(20000, false) == Approx(1.0 / 8));
}

TEST_CASE("weights refuse no lights and senseless sharpness") {
  const Direction q;
  CHECK_THROWS_AS(model::alias_free_weights(q, Lights{}, 1), core::BadInput);
  for (const double s : {-1.0, std::nan(""), std::numeric_limits<double>::infinity()}) {
    CHECK_THROWS_AS(model::alias_free_weights(q, Lights{q}, s), core::BadInput);
  }
  for (const double spacing : {0.0, -0.1, std::nan("")}) {
    CHECK_THROWS_AS(model::default_sharpness(spacing), core::BadInput);
  }
  CHECK(model::default_sharpness(0.1) == Approx(200));
}

}  // namespace lightstage
