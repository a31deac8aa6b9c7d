// Pictures as weighted sums: the fast sum against a plain one, and the methods made of it.
#include <atomic>
#include <catch2/catch.hpp>
#include <memory>
#include <mutex>
#include <set>

#include "core/display.h"
#include "core/error.h"
#include "core/parallel.h"
#include "core/sphere.h"
#include "model/alias_free_weights.h"
#include "model/classical.h"
#include "model/picture_sum.h"
#include "model/synthetic_scan.h"

namespace lightstage {

namespace {

using core::Direction;
using core::Image;
using core::Vec3;
using model::Domain;

struct ThreadCount {
  explicit ThreadCount(int n) { core::set_thread_count(n); }
  ~ThreadCount() { core::set_thread_count(0); }
};

// Values of both signs and of very different sizes.
test::PixelFunction rough() {
  return [](const Direction& light, int y, int x, int c) {
    const double v = std::sin(37.0 * light.x() + 11.0 * light.y() + 1.7 * y + 0.9 * x * x + c);
    return v * std::exp(8 * light.z());
  };
}

std::vector<double> some_weights(std::size_t n) {
  std::vector<double> weights;
  for (std::size_t i = 0; i < n; ++i) weights.push_back(i % 5 == 3 ? 0 : std::cos(double(3 * i)));
  return weights;
}

Image plain_sum(const core::OlatScan& scan, const std::vector<Vec3>& colours, bool to_rgb) {
  std::vector<Image> images;
  for (std::size_t i = 0; i < scan.light_count(); ++i)
    images.push_back(to_rgb ? core::to_rgb(*scan.image(i)) : *scan.image(i));
  Image result(images[0].size());
  for (int y = 0; y < result.height(); ++y)
    for (int x = 0; x < result.width(); ++x)
      for (int c = 0; c < result.channels(); ++c) {
        double sum = 0;
        for (std::size_t i = 0; i < images.size(); ++i)
          sum += (c == 0 ? colours[i].x : c == 1 ? colours[i].y : colours[i].z) * double(images[i](y, x, c));
        result(y, x, c) = static_cast<float>(sum);
      }
  return result;
}

// Which images of a scan were loaded.
struct Loads {
  std::mutex mutex;
  std::multiset<std::size_t> lights;
};

core::OlatScan watched_scan(const std::vector<Direction>& directions, core::ImageSize size,
                            const std::shared_ptr<Loads>& loads) {
  std::vector<core::Light> lights;
  for (const Direction& d : directions) lights.push_back({d, {}, {1, 1, 1}});
  return core::OlatScan("watched", lights, size, {}, [=](std::size_t i) {
    const std::lock_guard lock(loads->mutex);
    loads->lights.insert(i);
    return test::picture_of(size, directions[i], test::matt_ball(size));
  });
}

}  // namespace

TEST_CASE("the sum of a scan's pictures is bit-equal to the plain sum, at every size and thread count") {
  for (const core::ImageSize size : {core::ImageSize{1, 1, 1},
                                     {1, 1, 3},
                                     {3, 5, 3},
                                     {1, 4099, 1},
                                     {31, 37, 3},
                                     {64, 61, 4},
                                     {101, 103, 3},
                                     {2, 7, 2}}) {
    for (const std::size_t n : {1u, 15u, 16u, 17u, 50u}) {
      const core::OlatScan scan = test::scan_of(core::fibonacci_directions(n), size, rough());
      const std::vector<double> weights = some_weights(n);
      std::vector<Vec3> grey;
      for (const double w : weights) grey.push_back({w, w, w});
      const Image plain = plain_sum(scan, grey, false);
      for (const int threads : {1, 2, 3, 8}) {
        const ThreadCount with(threads);
        CAPTURE(size.height, size.width, size.channels, n, threads);
        model::PictureSum sum(size);
        sum.add(scan, weights);
        CHECK(sum.result() == plain);
      }
    }
  }
}

TEST_CASE("the coloured sum of a scan's pictures is bit-equal to the plain sum, and grey pictures count as RGB") {
  for (const int channels : {1, 3}) {
    const core::ImageSize size{33, 47, channels};
    const core::OlatScan scan = test::scan_of(core::fibonacci_directions(21), size, rough());
    std::vector<Vec3> colours;
    for (std::size_t i = 0; i < 21; ++i)
      colours.push_back(i == 4 ? Vec3{} : Vec3{double(i), i % 3 == 0 ? 0.0 : -0.5, 1.0 / double(i + 1)});
    const Image plain = plain_sum(scan, colours, true);
    for (const int threads : {1, 2, 5}) {
      const ThreadCount with(threads);
      model::PictureSum sum({33, 47, 3});
      sum.add(scan, colours);
      CHECK(sum.result() == plain);
    }
    model::PictureSum one_by_one({33, 47, 3});
    for (std::size_t i = 0; i < 21; ++i) one_by_one.add(core::to_rgb(*scan.image(i)), colours[i]);
    CHECK(one_by_one.result() == plain);
  }
}

TEST_CASE("a small picture is not lost in a sum of many bright ones that cancel") {
  // 1e7 + 1 is the last integer step of float32; the sum must carry far more.
  const auto value = [](const Direction& light, int, int, int) { return light.y() > 0.99 ? 1e-3 : 1e7; };
  const core::OlatScan scan = test::scan_of(core::fibonacci_directions(41), {2, 2, 3}, value);
  std::vector<double> weights;
  for (std::size_t i = 0; i < 41; ++i) weights.push_back(i % 2 == 0 ? 1 : -1);
  weights[2] = 0;  // as many of either sign remain
  weights[0] = 1;
  model::PictureSum sum({2, 2, 3});
  sum.add(scan, weights);
  double plain = 0;
  for (std::size_t i = 0; i < 41; ++i) plain += weights[i] * double((*scan.image(i))(0, 0, 0));
  CHECK(sum.result()(1, 1, 2) == static_cast<float>(plain));
}

TEST_CASE("pictures with weight 0 are not loaded") {
  const auto loads = std::make_shared<Loads>();
  const core::OlatScan scan = watched_scan(core::fibonacci_directions(40), {4, 4, 3}, loads);
  std::vector<double> weights(40, 0.0);
  weights[11] = -2;
  weights[39] = 1;
  model::PictureSum sum({4, 4, 3});
  sum.add(scan, weights);
  CHECK(loads->lights == std::multiset<std::size_t>{11, 39});
}

TEST_CASE("a sum refuses weights that do not fit or are not finite, and pictures of another size") {
  const core::OlatScan scan = test::scan_of(core::fibonacci_directions(3), {2, 2, 3}, rough());
  model::PictureSum sum({2, 2, 3});
  CHECK_THROWS_AS(sum.add(scan, std::vector<double>{1, 1}), core::BadInput);
  CHECK_THROWS_AS(sum.add(scan, std::vector<double>{1, std::nan(""), 1}), core::BadInput);
  CHECK_THROWS_AS(sum.add(scan, std::vector<Vec3>{{1, 1, 1}, {1, 1, INFINITY}, {1, 1, 1}}), core::BadInput);
  CHECK_THROWS_AS(sum.add(Image(2, 3, 3), {1, 1, 1}), core::BadInput);
  CHECK_THROWS_AS(sum.add(Image(2, 2, 3), {1, std::nan(""), 1}), core::BadInput);
  CHECK_THROWS_AS(model::PictureSum({2, 2, 1}).add(Image(2, 2, 1), {1, 1, 1}), core::BadInput);
  CHECK_THROWS_AS(model::PictureSum({0, 5, 3}), core::BadInput);
}

TEST_CASE("nearest gives the captured picture itself; equally near lights by lower index") {
  const std::vector<Direction> lights{Direction::from_vector({1, 0, 0}), Direction::from_vector({-1, 0, 0}),
                                      Direction::from_vector({1, 0, 0})};
  const core::OlatScan scan = test::scan_of(lights, {3, 3, 3}, rough());
  const auto nearest = model::make_nearest(scan);
  CHECK(nearest->name() == "nearest");
  CHECK(nearest->render(Direction::from_vector({0.9, 0.1, 0})) == *scan.image(0));
  CHECK(nearest->render(Direction::from_vector({-0.9, 0.1, 0})) == *scan.image(1));
  CHECK(nearest->render(Direction::from_vector({0, 1, 0})) == *scan.image(0));
  CHECK(nearest->linear_weights(Direction::from_vector({1, 0, 0})) == std::vector<double>{1, 0, 0});
}

TEST_CASE(
    "linear blends the k nearest lights with the alias-free weights and reads no other picture but for "
    "exposure") {
  const std::vector<Direction> lights = core::fibonacci_directions(100);
  const auto loads = std::make_shared<Loads>();
  const core::OlatScan scan = watched_scan(lights, {6, 5, 3}, loads);
  const auto linear = model::make_linear_blend(scan, 8, 60, Domain::kLinear);
  CHECK(linear->name() == "linear");
  const Direction query = Direction::from_vector({0.3, 0.5, 0.7});
  const std::vector<std::size_t> active = core::nearest_indices(lights, query, 8);
  std::vector<Direction> active_lights;
  for (const std::size_t i : active) active_lights.push_back(lights[i]);
  const std::vector<double> expected = model::alias_free_weights(query, active_lights, 60);
  const std::vector<double> weights = linear->linear_weights(query);
  std::vector<double> rest = weights;
  for (std::size_t i = 0; i < 8; ++i) {
    CHECK(weights[active[i]] == expected[i]);
    rest[active[i]] = 0;
  }
  CHECK(rest == std::vector<double>(100, 0.0));
  linear->render(query);
  for (const std::size_t loaded : loads->lights) CHECK(std::find(active.begin(), active.end(), loaded) != active.end());
  CHECK_THROWS_AS(model::make_linear_blend(scan, 0, 60, Domain::kLinear), core::UsageError);
}

TEST_CASE("methods with linear weights render exactly the sum that their weights say") {
  const core::OlatScan scan = test::scan_of(core::fibonacci_directions(60), {17, 19, 3}, rough());
  for (const char* name : {"nearest", "linear", "barycentric", "rbf", "bspline"}) {
    model::MethodOptions options;
    options.domain = Domain::kLinear;
    const auto method = model::make_interpolator(name, scan, options);
    CHECK(method->name() == name);
    for (const Direction& query : core::random_directions(5, 2)) {
      model::PictureSum sum(scan.image_size());
      sum.add(scan, method->linear_weights(query));
      CHECK(method->render(query) == sum.result());
    }
    // Two lights at once, one of them off in red.
    const Direction a = Direction::from_vector({1, 2, 3}), b = Direction::from_vector({-1, 0.5, 1});
    const auto colours =
        method->captured_colours(std::vector<model::DistantLight>{{a, {1, 2, 3}}, {b, {0, 0.5, 0.25}}});
    const auto weights_a = method->linear_weights(a), weights_b = method->linear_weights(b);
    REQUIRE(colours.size() == weights_a.size());
    for (std::size_t i = 0; i < colours.size(); ++i) {
      CHECK(colours[i].x == Approx(weights_a[i]).margin(1e-9));
      CHECK(colours[i].y == Approx(2 * weights_a[i] + 0.5 * weights_b[i]).margin(1e-9));
      CHECK(colours[i].z == Approx(3 * weights_a[i] + 0.25 * weights_b[i]).margin(1e-9));
    }
  }
}

TEST_CASE("display-encoded methods decode the weighted sum of encoded pictures, on every thread count") {
  const core::ImageSize size{23, 29, 3};
  // Noise below black, as a subtracted dark frame leaves, must not become NaN.
  const auto value = [ball = test::matt_ball(size)](const Direction& light, int y, int x, int c) {
    return 40 * ball(light, y, x, c) - (x % 3 == 0 ? 0.02 : 0);
  };
  const core::OlatScan scan = test::scan_of(core::fibonacci_directions(50), size, value);
  const auto linear_domain = model::make_rbf(scan, Domain::kLinear);
  const auto rbf = model::make_rbf(scan, Domain::kDisplay);
  CHECK(rbf->linear_weights(Direction()).empty());
  CHECK(rbf->captured_colours({}).empty());
  const double exposure = scan.exposure();
  for (const Direction& query : core::random_directions(4, 6)) {
    const std::vector<double> weights = linear_domain->linear_weights(query);
    Image plain(size);
    for (std::size_t v = 0; v < plain.values().size(); ++v) {
      double sum = 0;
      for (std::size_t i = 0; i < weights.size(); ++i)
        sum += weights[i] * std::pow(std::max(0.0, double(scan.image(i)->values()[v]) / exposure), 1 / 2.2);
      plain.values()[v] = static_cast<float>(exposure * std::pow(std::max(0.0, sum), 2.2));
    }
    const Image fast = rbf->render(query);
    double worst = 0;
    for (std::size_t v = 0; v < plain.values().size(); ++v)
      worst = std::max(worst, std::abs(double(fast.values()[v]) - double(plain.values()[v])) / exposure);
    CHECK(worst < 2e-6);
    for (const int threads : {1, 2, 7}) {
      const ThreadCount with(threads);
      CHECK(model::make_rbf(scan, Domain::kDisplay)->render(query) == fast);
    }
  }
}

TEST_CASE("every method gives back the captured pictures, whatever their values") {
  // All black, one hot pixel, the largest half, denormals.
  const std::vector<Direction> lights = core::fibonacci_directions(20);
  const auto value = [](const Direction& light, int y, int x, int) {
    if (light.y() > 0.9) return 0.0;
    if (x == 1 && y == 1) return 1e5;
    if (x == 2) return 65504.0;
    if (x == 3) return 1e-40;
    return 0.3 + 0.2 * light.x();
  };
  const core::OlatScan scan = test::scan_of(lights, {4, 5, 3}, value);
  for (const Domain domain : {Domain::kLinear, Domain::kDisplay})
    for (const char* name : {"nearest", "linear", "barycentric", "rbf", "bspline"}) {
      model::MethodOptions options;
      options.domain = domain;
      options.sharpness = 1e6;
      const auto method = model::make_interpolator(name, scan, options);
      for (std::size_t i = 0; i < lights.size(); ++i) {
        const Image picture = method->render(lights[i]);
        for (std::size_t v = 0; v < picture.values().size(); ++v) {
          CAPTURE(name, i, v);
          const double truth = double(scan.image(i)->values()[v]);
          REQUIRE(double(picture.values()[v]) == Approx(truth).epsilon(1e-5).margin(1e-30));
        }
      }
    }
}

TEST_CASE(
    "rbf follows a smooth subject more closely than blending, and blending more closely than the nearest "
    "light") {
  const core::ImageSize size{24, 24, 3};
  const core::OlatScan scan = test::scan_of(core::fibonacci_directions(120), size, test::matt_ball(size));
  const auto error = [&](const char* name) {
    model::MethodOptions options;
    options.domain = Domain::kLinear;
    const auto method = model::make_interpolator(name, scan, options);
    double sum = 0;
    for (const Direction& query : core::random_directions(40, 13)) {
      const Image truth = test::picture_of(size, query, test::matt_ball(size));
      const Image picture = method->render(query);
      for (std::size_t v = 0; v < truth.values().size(); ++v)
        sum += std::pow(double(picture.values()[v]) - double(truth.values()[v]), 2);
    }
    return std::sqrt(sum);
  };
  const double nearest = error("nearest"), linear = error("linear"), rbf = error("rbf");
  CHECK(rbf < 0.5 * linear);
  CHECK(linear < 0.7 * nearest);
}

TEST_CASE("a misspelt method is answered with the nearest name, superres without a model with what is missing") {
  const core::OlatScan scan = test::scan_of(core::fibonacci_directions(5), {2, 2, 3}, rough());
  std::vector<std::string> names;
  for (const model::MethodInfo& info : model::methods()) {
    names.push_back(info.name);
    CHECK_FALSE(info.summary.empty());
    CHECK_FALSE(info.citation.empty());
  }
  CHECK(names == std::vector<std::string>{"nearest", "linear", "barycentric", "rbf", "bspline", "fuchs",
                                          "photometric_stereo", "blend", "superres", "xu", "xu_adaptive", "meka"});
  CHECK_THROWS_AS(model::make_interpolator("superes", scan), core::UsageError);
  CHECK_THROWS_WITH(model::make_interpolator("superes", scan), Catch::Contains("did you mean 'superres'?"));
  CHECK_THROWS_WITH(model::make_interpolator("superres", scan), Catch::Contains("model file"));
}

}  // namespace lightstage
