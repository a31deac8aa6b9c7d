// The subject under new light, against sums written out.
#include <catch2/catch.hpp>
#include <memory>
#include <numbers>

#include "core/error.h"
#include "core/parallel.h"
#include "core/sphere.h"
#include "model/methods.h"
#include "model/synthetic_scan.h"
#include "relight/environment_relighter.h"
#include "relight/relight.h"
#include "support/support.h"

namespace lightstage {

namespace {

using core::Direction;
using core::Image;
using core::Vec3;
using relight::DistantLight;
using relight::Environment;

constexpr double kPi = std::numbers::pi;
constexpr core::ImageSize kSize{20, 21, 3};

core::OlatScan ball_scan(std::size_t lights = 150, core::ImageSize size = kSize) {
  return test::scan_of(core::fibonacci_directions(lights), size, test::matt_ball(size));
}

std::unique_ptr<model::LightInterpolator> method(const char* name, const core::OlatScan& scan,
                                                 model::Domain domain = model::Domain::kLinear) {
  model::MethodOptions options;
  options.domain = domain;
  return model::make_interpolator(name, scan, options);
}

// Knows the ball under any light; has no linear weights, and counts what it is asked for.
class TrueBall : public model::LightInterpolator {
 public:
  explicit TrueBall(core::ImageSize size = kSize) : scan_(ball_scan(10, size)) {}
  std::string_view name() const override { return "true"; }
  const core::OlatScan& scan() const override { return scan_; }
  Image render(const Direction& query) const override {
    ++asked;
    return test::picture_of(scan_.image_size(), query, test::matt_ball(scan_.image_size()));
  }
  mutable int asked = 0;

 private:
  core::OlatScan scan_;
};

Image constant_map(int height, int width, float value) {
  Image map(height, width, 3);
  std::fill(map.values().begin(), map.values().end(), value);
  return map;
}

Image coloured_map(int height, int width) {
  Image map(height, width, 3);
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x)
      for (int c = 0; c < 3; ++c)
        map(y, x, c) = float(1 + 0.5 * std::sin(6.28 * x / width + c) + (c == 2 ? 1.0 * y / height : 0));
  map(height / 4, width / 3, 0) = 1e3f;
  return map;
}

relight::EnvironmentReport under(const model::LightInterpolator& interpolator, const Environment& map,
                                 const relight::Goal& goal = relight::ErrorGoal{}) {
  return relight::EnvironmentRelighter(interpolator).relight(map, goal);
}

double largest_difference(const Image& a, const Image& b) {
  REQUIRE(a.size() == b.size());
  double largest = 0;
  for (std::size_t i = 0; i < a.values().size(); ++i)
    largest = std::max(largest, std::abs(double(a.values()[i]) - double(b.values()[i])));
  return largest;
}

// Every pixel of the map as a light of its own.
Image plain_environment(const model::LightInterpolator& method, const Environment& map) {
  const core::ImageSize size = method.scan().image_size();
  std::vector<double> sums(std::size_t(size.height) * std::size_t(size.width) * 3, 0.0);
  for (int y = 0; y < map.height(); ++y)
    for (int x = 0; x < map.width(); ++x) {
      const Image picture = core::to_rgb(method.render(map.direction(y, x)));
      for (std::size_t v = 0; v < sums.size(); ++v)
        sums[v] += double(map.radiance()(y, x, int(v % 3))) * map.solid_angle(y) / kPi * double(picture.values()[v]);
    }
  Image result(size.height, size.width, 3);
  for (std::size_t v = 0; v < sums.size(); ++v) result.values()[v] = float(sums[v]);
  return result;
}

}  // namespace

TEST_CASE("one light is the method's picture times its colour") {
  const core::OlatScan scan = ball_scan();
  const Direction query = Direction::from_vector({0.3, 0.2, 1});
  for (const char* name : {"nearest", "linear", "rbf"})
    for (const model::Domain domain : {model::Domain::kLinear, model::Domain::kDisplay}) {
      const auto interpolator = method(name, scan, domain);
      const Image picture = interpolator->render(query);
      CHECK(largest_difference(relight::relight_direction(*interpolator, query).image, picture) < 1e-6);
      const Image red = relight::relight_direction(*interpolator, query, {2, 0, 0.5}).image;
      for (std::size_t v = 0; v < picture.values().size(); ++v) {
        const double factor = v % 3 == 0 ? 2 : v % 3 == 1 ? 0 : 0.5;
        REQUIRE(red.values()[v] == Approx(factor * double(picture.values()[v])).margin(1e-6));
      }
    }
}

TEST_CASE("grey scans are relit in colour") {
  const TrueBall ball({9, 9, 1});
  const Direction query = Direction::from_vector({0, 0.5, 1});
  const Image grey = ball.render(query);
  const Image relit = relight::relight_direction(ball, query, {1, 2, 3}).image;
  REQUIRE(relit.channels() == 3);
  CHECK(relit(4, 4, 2) == Approx(3 * grey(4, 4)));
  const auto rbf = method("rbf", ball_scan(60, {9, 9, 1}));
  CHECK(relight::relight_direction(*rbf, query, {1, 2, 3}).image(4, 4, 1) == Approx(2 * grey(4, 4)).epsilon(0.02));
}

TEST_CASE("lights without any irradiance are not synthesised; negative or NaN irradiance is refused") {
  const TrueBall ball;
  const std::vector<DistantLight> lights{{Direction(), {0, 0, 0}}, {Direction(), {0, 1e-3, 0}}, {Direction(), {}}};
  const relight::RelightReport report = relight::relight_lights(ball, lights);
  CHECK(report.directions_synthesised == 1);
  CHECK(ball.asked == 1);
  CHECK(report.seconds >= 0);
  CHECK_THROWS_AS(relight::relight_direction(ball, Direction(), {1, -1, 1}), core::BadInput);
  CHECK_THROWS_AS(relight::relight_direction(ball, Direction(), {1, std::nan(""), 1}), core::BadInput);
  CHECK(relight::relight_lights(ball, {}).image == Image(kSize));
}

TEST_CASE("an area light of radius 0 is a directional light, one of 180 degrees comes from everywhere alike") {
  const core::OlatScan scan = ball_scan();
  const auto rbf = method("rbf", scan);
  const TrueBall ball;
  const Direction light = Direction::from_vector({1, 1, 2});
  CHECK(relight::relight_area(*rbf, light, 0, 7).image == relight::relight_direction(*rbf, light).image);
  CHECK(relight::relight_area(ball, light, 0, 7).image == relight::relight_direction(ball, light).image);
  // A matt surface under uniform light from all directions of total 1 (in units of pi): 1/4.
  const relight::RelightReport all = relight::relight_area(ball, light, 180, 4000);
  CHECK(all.directions_synthesised == 4000);
  CHECK(all.image(10, 10, 0) == Approx(0.9 / 4).epsilon(1e-3));
  CHECK(all.image(5, 7, 1) == Approx(0.65 / 4).epsilon(1e-3));
}

TEST_CASE("an area light is the mean over its cap: of a matt surface (1 + cos radius)/2 of what it has from the axis") {
  const TrueBall ball;
  const double facing = std::sqrt(1 - 0.05 * 0.05);  // the cosine of pixel (10, 10), just below the ball's centre
  for (const double radius : {0.001, 20.0, 80.0}) {
    const Image picture = relight::relight_area(ball, Direction(), radius, 1000).image;
    CHECK(picture(10, 10, 0) / 0.9 == Approx(facing * (1 + std::cos(radius * kPi / 180)) / 2).epsilon(2e-4));
    // Where the axis is nearly +y, and by three times as many samples.
    const Direction up = Direction::from_vector({0, 1, 1e-9});
    CHECK(largest_difference(relight::relight_area(ball, up, radius, 500).image,
                             relight::relight_area(ball, up, radius, 1500).image) < 5e-3);
  }
  const TrueBall counted;
  CHECK(relight::relight_area(counted, Direction(), 5, 17).directions_synthesised == 17);
  CHECK(counted.asked == 17);
  CHECK_THROWS_AS(relight::relight_area(ball, Direction(), -1, 4), core::UsageError);
  CHECK_THROWS_AS(relight::relight_area(ball, Direction(), 181, 4), core::UsageError);
  CHECK_THROWS_AS(relight::relight_area(ball, Direction(), std::nan(""), 4), core::UsageError);
  CHECK_THROWS_AS(relight::relight_area(ball, Direction(), 5, 0), core::UsageError);
}

TEST_CASE("a small environment equals the sum over its pixels, each a light of its own") {
  const core::OlatScan scan = ball_scan(40);  // about 30 degrees apart: boxes of 3.5 degrees hold single pixels
  const Environment map(coloured_map(24, 48));
  for (const char* name : {"nearest", "linear", "rbf"}) {
    const auto interpolator = method(name, scan);
    const Image plain = plain_environment(*interpolator, map);
    const relight::EnvironmentReport relit = under(*interpolator, map);
    CHECK(relit.directions_synthesised == 0);
    CHECK(largest_difference(relit.image, plain) < 2e-6 * double(plain(10, 10, 0)));
  }
}

TEST_CASE("a large environment taken in boxes is within 0.1 % of the sum over its pixels") {
  const core::OlatScan scan = ball_scan(60);  // 26 degrees apart: boxes of two pixels
  const Environment map(coloured_map(120, 240));
  for (const char* name : {"linear", "rbf"}) {
    const auto interpolator = method(name, scan);
    const std::vector<DistantLight> pixels = map.lights(0);
    CHECK(map.lights(core::median_spacing_radians(scan.directions()) / 8).size() < pixels.size() / 3);
    const Image exact = relight::relight_lights(*interpolator, pixels).image;
    const Image boxes = under(*interpolator, map).image;
    CHECK(largest_difference(boxes, exact) < 1e-3 * double(exact(10, 10, 0)));
  }
}

TEST_CASE("a white surface under a constant sky of radiance 1 has radiance 1, by every method") {
  const core::OlatScan scan = ball_scan(200);
  const Environment sky(constant_map(64, 128, 1));
  for (const char* name : {"nearest", "linear", "rbf"})
    CHECK(under(*method(name, scan), sky).image(10, 10, 0) == Approx(0.9).epsilon(0.02));
  const TrueBall ball;
  const relight::EnvironmentReport relit = under(ball, sky, relight::Exhaustive{});
  CHECK(relit.directions_synthesised == 64 * 128);
  CHECK(relit.image(10, 10, 0) == Approx(0.9).epsilon(5e-3));
  CHECK(relit.image(6, 9, 2) == Approx(0.4).epsilon(5e-3));
}

TEST_CASE("a black environment gives a black picture and asks for nothing") {
  const Environment black(Image(8, 16, 3));
  const TrueBall ball;
  const relight::EnvironmentReport dark = under(ball, black);
  CHECK(dark.directions_synthesised == 0);
  CHECK(dark.image == Image(kSize));
  CHECK(under(*method("rbf", ball_scan()), black).image == Image(kSize));
}

TEST_CASE("turning the environment and the subject together changes nothing") {
  // Light from longitude 0 turned to 90 degrees lights the ball from +x.
  Image image(32, 64, 3);
  image(15, 31, 0) = image(15, 32, 0) = image(16, 31, 0) = image(16, 32, 0) = 1000;
  const TrueBall ball;
  const Environment front(image);
  const Image from_front = under(ball, front).image;
  const Image from_right = under(ball, front.rotated(90)).image;
  CHECK(largest_difference(from_front, under(ball, front.rotated(360)).image) == 0);
  // From +x the right half is lit, the left half dark.
  CHECK(from_right(10, 18, 0) > 10 * std::max(1e-6f, from_right(10, 2, 0)));
  const double facing = std::sqrt(1 - std::pow(8.0 / 10.5, 2));
  CHECK(from_right(10, 18, 0) / from_front(10, 10, 0) == Approx(std::sqrt(1 - facing * facing)).epsilon(0.05));
}

TEST_CASE("relit pictures are bit-equal for every thread count") {
  const core::OlatScan scan = ball_scan();
  const Environment map(coloured_map(45, 90));
  std::vector<std::unique_ptr<model::LightInterpolator>> methods;
  methods.push_back(method("rbf", scan));
  methods.push_back(method("linear", scan));
  methods.push_back(method("rbf", scan, model::Domain::kDisplay));
  methods.push_back(std::make_unique<TrueBall>());
  for (const auto& interpolator : methods) {
    core::set_thread_count(1);
    const Image alone = under(*interpolator, map).image;
    const Image area = relight::relight_area(*interpolator, Direction(), 30, 20).image;
    for (const int threads : {2, 3, 8}) {
      core::set_thread_count(threads);
      CHECK(under(*interpolator, map).image == alone);
      CHECK(relight::relight_area(*interpolator, Direction(), 30, 20).image == area);
    }
    core::set_thread_count(0);
  }
}

TEST_CASE("under a real environment the methods agree with the true ball") {
  const auto path = test::real_data("envmaps/venice_sunset_1k.hdr");
  if (path.empty()) SKIP_TEST("no real environments here");
  const Environment map = Environment::read(path);
  const TrueBall ball;
  const Image truth = relight::relight_lights(ball, map.lights(0.05)).image;
  const double scale = double(*std::max_element(truth.values().begin(), truth.values().end()));
  const core::OlatScan scan = ball_scan(200);
  CHECK(largest_difference(under(*method("rbf", scan), map).image, truth) < 0.05 * scale);
  CHECK(largest_difference(under(ball, map).image, truth) < 0.05 * scale);
}

}  // namespace lightstage
