// The methods that take pictures apart into layers, on pictures whose layers are known.
#include <catch2/catch.hpp>
#include <limits>

#include "core/parallel.h"
#include "core/sphere.h"
#include "model/methods.h"
#include "model/synthetic_scan.h"
#include "support/support.h"

namespace lightstage {

namespace {

using core::Direction;
using core::Image;
using core::Vec3;

constexpr core::ImageSize kSize{72, 72, 3};
constexpr double kPerRadian = 60;  // pixels that shadows and highlights move

Vec3 highlight_place(const Direction& light) {
  return {36 + kPerRadian * light.x(), 36 - kPerRadian * light.y(), 0};
}

// A grey wall that faces +z, and a highlight that moves with the light.
double wall_with_highlight(const Direction& light, int y, int x, int) {
  const Vec3 at = highlight_place(light);
  const double dx = x - at.x, dy = y - at.y;
  return std::max(0.0, 0.2 * light.z()) + (light.z() > 0 ? std::exp(-(dx * dx + dy * dy) / (2 * 2.5 * 2.5)) : 0);
}

// The same wall with a shadow on the left, whose edge moves with the light and is one pixel wide.
double edge_place(const Direction& light) {
  return 36 + kPerRadian * light.x();
}
double wall_with_shadow(const Direction& light, int, int x, int) {
  return std::max(0.0, light.z()) * std::clamp(x - edge_place(light) + 0.5, 0.05, 1.0);
}

Direction between(const Direction& a, const Direction& b, double share = 0.5) {
  return Direction::from_vector((1 - share) * a.vec() + share * b.vec());
}

// Neighbouring lights before the wall.
std::vector<std::pair<Direction, Direction>> neighbours(const std::vector<Direction>& lights) {
  std::vector<std::pair<Direction, Direction>> pairs;
  for (const Direction& light : lights) {
    if (std::abs(light.x()) > 0.3 || std::abs(light.y()) > 0.3 || light.z() < 0) continue;
    pairs.emplace_back(light, lights[core::nearest_indices(lights, light, 2)[1]]);
  }
  return pairs;
}

double largest_difference(const Image& a, const Image& b) {
  double largest = 0;
  for (std::size_t v = 0; v < a.values().size(); ++v)
    largest = std::max(largest, std::abs(double(a.values()[v]) - double(b.values()[v])));
  return largest;
}

class ThreadCount {
 public:
  explicit ThreadCount(int n) { core::set_thread_count(n); }
  ~ThreadCount() { core::set_thread_count(0); }
};

const std::vector<std::string> kMethods{"fuchs", "photometric_stereo"};

}  // namespace

TEST_CASE("layers: midway between two lights a highlight stands where it should, and there is one") {
  const std::vector<Direction> lights = core::fibonacci_directions(300);
  const core::OlatScan scan = test::scan_of(lights, kSize, wall_with_highlight);
  const auto linear = model::make_interpolator("linear", scan);
  for (const std::string& name : kMethods) {
    const auto method = model::make_interpolator(name, scan);
    double worst = 0, peak = 0, linear_peak = 0;
    std::size_t count = 0;
    for (const auto& [a, b] : neighbours(lights)) {
      if (++count > 6) break;
      const Direction query = between(a, b);
      const Vec3 truth = highlight_place(query);
      const auto above_wall = [&](const Image& picture, int y, int x) {
        return std::max(0.0, double(picture(y, x)) - 0.2 * query.z() - 0.1);
      };
      const Image picture = method->render(query), blended = linear->render(query);
      double sum = 0, sum_x = 0, sum_y = 0;
      for (int y = 0; y < kSize.height; ++y) {
        for (int x = 0; x < kSize.width; ++x) {
          const double value = above_wall(picture, y, x);
          sum += value;
          sum_x += value * x;
          sum_y += value * y;
        }
      }
      REQUIRE(sum > 0);
      worst = std::max(worst, std::hypot(sum_x / sum - truth.x, sum_y / sum - truth.y));
      const int x = int(std::lround(truth.x)), y = int(std::lround(truth.y));
      peak += above_wall(picture, y, x) / 6;
      linear_peak += above_wall(blended, y, x) / 6;
    }
    CAPTURE(name, worst, peak, linear_peak);
    CHECK(count > 6);
    CHECK(worst < 1);
    CHECK(peak > 0.5);
    CHECK(linear_peak < 0.3);
  }
}

TEST_CASE("layers: midway between two lights a shadow's edge stands where it should, in one step") {
  const std::vector<Direction> lights = core::fibonacci_directions(300);
  const core::OlatScan scan = test::scan_of(lights, kSize, wall_with_shadow);
  const auto linear = model::make_interpolator("linear", scan);
  for (const std::string& name : kMethods) {
    const auto method = model::make_interpolator(name, scan);
    double error = 0, linear_error = 0, worst_place = 0;
    std::size_t count = 0;
    for (const auto& [a, b] : neighbours(lights)) {
      if (++count > 6) break;
      const Direction query = between(a, b);
      const Image picture = method->render(query), blended = linear->render(query);
      // Half way from dark to bright, as shown.
      const double level = query.z() * std::pow((1 + std::pow(0.05, 1 / 2.2)) / 2, 2.2);
      double place = 0;
      for (int x = 0; x < kSize.width; ++x) {
        const double truth = wall_with_shadow(query, 0, x, 0);
        error += std::abs(picture(36, x) - truth);
        linear_error += std::abs(blended(36, x) - truth);
        if (x > 0 && place == 0 && picture(36, x) > level)
          place = x - (picture(36, x) - level) / (picture(36, x) - picture(36, x - 1));
      }
      worst_place = std::max(worst_place, std::abs(place - edge_place(query)));
    }
    CAPTURE(name, error, linear_error, worst_place);
    CHECK(worst_place < (name == "fuchs" ? 0.75 : 1.5));
    CHECK(error < 0.6 * linear_error);
  }
}

TEST_CASE("layers: pictures change continuously where other lights become the nearest") {
  const std::vector<Direction> lights = core::fibonacci_directions(90);
  const auto value = [](const Direction& light, int y, int x, int c) {
    return 0.5 * wall_with_highlight(light, y * 2, x * 2, c) + 0.5 * wall_with_shadow(light, y * 2, x * 2, c);
  };
  const core::OlatScan scan = test::scan_of(lights, {36, 36, 3}, value);
  const auto active = [&](const Direction& query) {
    std::vector<std::size_t> set = core::nearest_indices(lights, query, 6);
    std::sort(set.begin(), set.end());
    return set;
  };
  const Direction from = Direction::from_vector({-0.5, 0.3, 0.9}), to = Direction::from_vector({0.5, -0.4, 0.9});
  for (const std::string& name : kMethods) {
    const auto method = model::make_interpolator(name, scan);
    int changes = 0;
    constexpr int kSteps = 60;
    for (int step = 0; step < kSteps && changes < 8; ++step) {
      double low = double(step) / kSteps, high = double(step + 1) / kSteps;
      const auto before = active(between(from, to, low));
      if (active(between(from, to, high)) == before) continue;
      ++changes;
      while (high - low > 1e-9) {
        const double middle = (low + high) / 2;
        (active(between(from, to, middle)) == before ? low : high) = middle;
      }
      CAPTURE(name, low);
      CHECK(largest_difference(method->render(between(from, to, low)), method->render(between(from, to, high))) < 1e-4);
    }
    CHECK(changes == 8);
    // And elsewhere: a tenth of a step changes at most about a tenth as much.
    const Image here = method->render(between(from, to, 0.31));
    CHECK(largest_difference(here, method->render(between(from, to, 0.31 + 1e-6))) < 1e-4);
  }
}

TEST_CASE("layers: the same pictures for every thread count") {
  const core::OlatScan scan = test::scan_of(core::fibonacci_directions(60), {37, 41, 3}, wall_with_highlight);
  const Direction query = Direction::from_vector({0.1, 0.15, 1});
  for (const std::string& name : kMethods) {
    const Image picture = model::make_interpolator(name, scan)->render(query);
    for (const int threads : {1, 2, 7}) {
      const ThreadCount with(threads);
      CHECK(model::make_interpolator(name, scan)->render(query) == picture);
    }
  }
}

TEST_CASE("layers: finite and not negative at the extremes") {
  const std::vector<core::ImageSize> sizes{{1, 1, 3}, {1, 1, 1}, {2, 5, 3}, {17, 3, 1}, {19, 23, 3}};
  const std::vector<test::PixelFunction> pictures{
      [](auto&&...) { return 0.0; }, [](auto&&...) { return -0.1; },
      [](const Direction& light, int y, int x, int) { return (x + y) % 5 == 0 ? 1e5 : 0.1 * (1 + light.y()); },
      [](const Direction& light, int, int x, int) { return x % 2 == 0 ? 65504.0 : 1e-40 * (1 + light.z()); },
      [](const Direction& light, int y, int, int) { return y % 2 == 0 ? 3e38 * std::abs(light.x()) : 1e-38; }};
  const Direction up = Direction::from_vector({0, 1, 0}), left = Direction::from_vector({-1, 0, 0}), front;
  const std::vector<std::vector<Direction>> stages{
      {up}, {up, left}, {up, up, up}, {up, left, front}, core::fibonacci_directions(9)};
  for (const core::ImageSize size : sizes) {
    for (const auto& picture : pictures) {
      for (const auto& lights : stages) {
        const core::OlatScan scan = test::scan_of(lights, size, picture);
        for (const std::string& name : kMethods) {
          const auto method = model::make_interpolator(name, scan);
          for (const Direction& query :
               {lights[0], Direction::from_vector({0, -1, 0}), Direction::from_vector({-1, 1, 0.01})}) {
            const Image result = method->render(query);
            REQUIRE(result.size() == size);
            for (const float value : result.values()) REQUIRE((std::isfinite(value) && value >= 0));
          }
        }
      }
    }
  }
}

}  // namespace lightstage
