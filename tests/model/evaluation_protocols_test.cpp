// That evaluations compare what they say: pictures here carry the index of their light.
#include <catch2/catch.hpp>
#include <chrono>
#include <memory>
#include <numbers>
#include <thread>

#include "core/display.h"
#include "core/error.h"
#include "core/image_file.h"
#include "core/light_list.h"
#include "core/sphere.h"
#include "model/evaluation.h"
#include "model/methods.h"
#include "model/metrics.h"
#include "model/synthetic_scan.h"
#include "support/support.h"

namespace lightstage {

namespace {

using core::Direction;
using core::Image;

constexpr core::ImageSize kSize{6, 7, 3};

Image constant(float value) {
  Image image(kSize);
  std::fill(image.values().begin(), image.values().end(), value);
  return image;
}

// Light i of n has a picture of the constant value (i + 1)/n.
core::OlatScan numbered_scan(const std::vector<Direction>& lights) {
  return test::scan_of(lights, kSize, [lights](const Direction& light, int, int, int) {
    const auto at = std::find(lights.begin(), lights.end(), light);
    return double(at - lights.begin() + 1) / double(lights.size());
  });
}

// A method made of a function.
class Fake : public model::LightInterpolator {
 public:
  using Render = std::function<Image(const core::OlatScan&, const Direction&)>;
  Fake(const core::OlatScan& scan, Render render) : scan_(scan), render_(std::move(render)) {}
  std::string_view name() const override { return "fake"; }
  const core::OlatScan& scan() const override { return scan_; }
  Image render(const Direction& query) const override { return render_(scan_, query); }

 private:
  core::OlatScan scan_;
  Render render_;
};

model::InterpolatorFactory fake(Fake::Render render) {
  return [render](const core::OlatScan& scan) { return std::make_unique<Fake>(scan, render); };
}

model::InterpolatorFactory method(const std::string& name, model::MethodOptions options = {}) {
  return [=](const core::OlatScan& scan) { return model::make_interpolator(name, scan, options); };
}

// Knows the whole scan, and answers with the picture of the very light asked for, `offset` too bright.
model::InterpolatorFactory oracle(const core::OlatScan& whole, float offset = 0) {
  return fake([whole, offset](const core::OlatScan&, const Direction& query) {
    const auto& lights = whole.directions();
    const auto at = std::find(lights.begin(), lights.end(), query);
    Image image = *whole.image(std::size_t(at - lights.begin()));
    for (float& v : image.values()) v += offset;
    return image;
  });
}

std::vector<model::MethodScore> held_out(const core::OlatScan& scan,
                                         const std::vector<model::InterpolatorFactory>& methods, int every,
                                         bool linear_values = false) {
  return model::evaluate_held_out(scan, methods, every, {linear_values});
}

}  // namespace

TEST_CASE("pictures are judged scaled by the exposure, clipped and encoded") {
  Image image(1, 4, 1);
  image.values()[0] = -1;
  image.values()[1] = 0.5f;
  image.values()[2] = 2;
  image.values()[3] = 5;
  const Image linear = model::judged(image, 2, true);
  CHECK(linear(0, 0) == 0);
  CHECK(linear(0, 1) == 0.25f);
  CHECK(linear(0, 2) == 1);
  CHECK(linear(0, 3) == 1);
  const Image encoded = model::judged(image, 2, false);
  CHECK(encoded(0, 0) == 0);
  CHECK(encoded(0, 1) == Approx(std::pow(0.25, 1 / 2.2)).epsilon(1e-6));
  CHECK(encoded(0, 3) == 1);
  for (const double exposure : {0.0, -1.0, std::nan(""), double(INFINITY)})
    CHECK_THROWS_AS(model::judged(image, exposure, true), core::BadInput);
}

TEST_CASE("a method that returns the truth scores 0 under both protocols") {
  const core::OlatScan scan = numbered_scan(core::fibonacci_directions(20));
  const std::vector<model::InterpolatorFactory> methods{oracle(scan)};
  const auto check = [](const std::vector<model::MethodScore>& scores) {
    REQUIRE(scores.size() == 1);
    CHECK(scores[0].name == "fake");
    CHECK(scores[0].images == 20);
    CHECK(scores[0].rmse == 0);
    CHECK(scores[0].h1 == 0);
    CHECK(scores[0].dssim == 0);
    CHECK(scores[0].seconds_per_image > 0);
  };
  check(held_out(scan, methods, 1));
  std::vector<std::size_t> asked;
  check(model::evaluate_against_truth(scan, methods, scan.directions(), [&](std::size_t i) {
    asked.push_back(i);
    return *scan.image(i);
  }));
  std::vector<std::size_t> each_once;
  for (std::size_t i = 0; i < 20; ++i) each_once.push_back(i);
  CHECK(asked == each_once);
}

TEST_CASE("the light left out is compared with the picture of that light and no other") {
  const core::OlatScan scan = numbered_scan(core::fibonacci_directions(20));
  // Every prediction is wrong by the same known amount; a comparison with any other light's picture, all of
  // which differ by multiples of 1/20, would give another error. The exposure is the largest value, 1; 0.01
  // keeps clear of the clipping but for the last light.
  const auto scores = held_out(scan, {oracle(scan, -0.01f)}, 1, true);
  CHECK(scan.exposure() == Approx(1));
  CHECK(scores[0].rmse == Approx(0.01).epsilon(1e-4));
  CHECK(scores[0].h1 == Approx(0.01).epsilon(1e-4));
}

TEST_CASE("every n-th light is left out, and the method's scan never holds it") {
  const std::vector<Direction> lights = core::fibonacci_directions(20);
  const core::OlatScan scan = numbered_scan(lights);
  std::vector<std::size_t> left_out;
  const auto spy = fake([&](const core::OlatScan& rest, const Direction& query) {
    const auto at = std::find(lights.begin(), lights.end(), query);
    left_out.push_back(std::size_t(at - lights.begin()));
    CHECK(rest.light_count() == 19);
    const float mark = (*scan.image(left_out.back()))(0, 0, 0);
    for (std::size_t i = 0; i < rest.light_count(); ++i) {
      CHECK_FALSE(rest.directions()[i] == query);
      CHECK((*rest.image(i))(0, 0, 0) != mark);
    }
    return constant(0);
  });
  const auto scores = held_out(scan, {spy}, 6);
  CHECK(left_out == std::vector<std::size_t>{0, 6, 12, 18});
  CHECK(scores[0].images == 4);
}

TEST_CASE("the error is the root of the mean over images of the mean squared error over the mask") {
  const std::vector<Direction> lights = core::fibonacci_directions(4);
  Image mask(kSize.height, kSize.width, 1);
  mask(2, 3) = mask(2, 4) = 1;
  const auto value = [&](const Direction& light, int y, int x, int) {
    // Far from what any method predicts outside the mask.
    if (!(y == 2 && (x == 3 || x == 4))) return 10.0;
    const auto at = std::find(lights.begin(), lights.end(), light);
    return at == lights.begin() ? 1.0 : 0.1 * double(at - lights.begin());
  };
  const core::OlatScan scan = test::scan_of(lights, kSize, value, mask);
  const auto black = fake([](const core::OlatScan&, const Direction&) { return constant(0); });
  const auto white = fake([](const core::OlatScan&, const Direction&) { return constant(5); });
  const auto scores = held_out(scan, {black, white}, 1, true);
  const double e = scan.exposure();
  const auto at = [&](double v) { return std::min(1.0, v / e); };
  const double zero_error = std::pow(at(1), 2) + std::pow(at(0.1), 2) + std::pow(at(0.2), 2) + std::pow(at(0.3), 2);
  const double one_error =
      std::pow(1 - at(1), 2) + std::pow(1 - at(0.1), 2) + std::pow(1 - at(0.2), 2) + std::pow(1 - at(0.3), 2);
  CHECK(scores[0].rmse == Approx(std::sqrt(zero_error / 4)).epsilon(1e-5));
  CHECK(scores[1].rmse == Approx(std::sqrt(one_error / 4)).epsilon(1e-5));
}

TEST_CASE("nearest is scored by the picture of the nearest other light") {
  const std::vector<Direction> lights = core::fibonacci_directions(15);
  const core::OlatScan scan = numbered_scan(lights);
  double sum = 0;
  for (std::size_t i = 0; i < lights.size(); ++i) {
    const std::size_t other = core::nearest_indices(lights, lights[i], 2)[1];
    const auto shown = [&](std::size_t light) {
      return std::pow(std::min(1.0, double(light + 1) / 15 / scan.exposure()), 1 / 2.2);
    };
    sum += std::pow(shown(i) - shown(other), 2);
  }
  const auto scores = held_out(scan, {method("nearest")}, 1);
  CHECK(scores[0].name == "nearest");
  CHECK(scores[0].rmse == Approx(std::sqrt(sum / 15)).epsilon(1e-5));
}

TEST_CASE("every method runs under both protocols, and rbf is exact where the subject is linear in the light") {
  const auto value = [](const Direction& light, int y, int x, int c) {
    return 2 + light.x() * 0.1 * x + light.y() * 0.1 * y + light.z() * 0.1 * c;
  };
  const core::OlatScan scan = test::scan_of(core::fibonacci_directions(40), kSize, value);
  model::MethodOptions options;
  options.domain = model::Domain::kLinear;
  const std::vector<model::InterpolatorFactory> methods{method("rbf", options), method("linear", options)};
  CHECK(held_out(scan, methods, 3)[0].rmse < 1e-6);
  CHECK(held_out(scan, methods, 3)[1].rmse > 1e-4);
  const std::vector<Direction> between = model::off_grid_directions(scan.directions(), 10, 1);
  const auto scores = model::evaluate_against_truth(
      scan, methods, between, [&](std::size_t i) { return test::picture_of(kSize, between[i], value); });
  CHECK(scores[0].images == 10);
  CHECK(scores[0].rmse < 1e-6);
  CHECK(scores[1].rmse > 1e-4);
}

TEST_CASE("a grey scan may be answered in colour") {
  const core::ImageSize grey{3, 3, 1};
  const auto value = [](const Direction& light, int, int, int) { return 1 + light.y(); };
  const core::OlatScan scan = test::scan_of(core::fibonacci_directions(6), grey, value);
  const auto colour = fake([&](const core::OlatScan&, const Direction& query) {
    return core::to_rgb(test::picture_of(grey, query, value));
  });
  CHECK(held_out(scan, {colour}, 1)[0].rmse == 0);
}

TEST_CASE("only rendering is timed, not fitting") {
  const core::OlatScan scan = numbered_scan(core::fibonacci_directions(3));
  const model::InterpolatorFactory slow_to_fit = [](const core::OlatScan& rest) {
    std::this_thread::sleep_for(std::chrono::milliseconds(100));
    return std::make_unique<Fake>(rest, [](const core::OlatScan&, const Direction&) {
      std::this_thread::sleep_for(std::chrono::milliseconds(5));
      return constant(0);
    });
  };
  const auto scores = held_out(scan, {slow_to_fit}, 1);
  CHECK(scores[0].seconds_per_image >= 0.005);
  CHECK(scores[0].seconds_per_image < 0.08);
}

TEST_CASE("a method that makes NaN, a step below 1 and a scan of one light are refused") {
  const core::OlatScan scan = numbered_scan(core::fibonacci_directions(3));
  const auto broken = fake([](const core::OlatScan&, const Direction&) { return constant(std::nanf("")); });
  CHECK_THROWS_AS(held_out(scan, {broken}, 1), core::Error);
  CHECK_THROWS_AS(held_out(scan, {method("nearest")}, 0), core::UsageError);
  CHECK_THROWS_AS(held_out(numbered_scan({Direction()}), {method("nearest")}, 1), core::UsageError);
  CHECK(held_out(scan, {}, 1).empty());
}

TEST_CASE("off-grid directions are the same for a seed, stay where lights are, and fill that region") {
  std::vector<Direction> front;
  for (const Direction& d : core::fibonacci_directions(200))
    if (d.z() > 0) front.push_back(d);
  const double spacing = core::median_spacing_radians(front);
  const std::vector<Direction> chosen = model::off_grid_directions(front, 3000, 7);
  REQUIRE(chosen.size() == 3000);
  CHECK(model::off_grid_directions(front, 3000, 7) == chosen);
  CHECK_FALSE(model::off_grid_directions(front, 3000, 8) == chosen);
  const std::vector<Direction> fewer = model::off_grid_directions(front, 60, 7);
  CHECK(std::equal(fewer.begin(), fewer.end(), chosen.begin()));
  int left = 0;
  for (const Direction& d : chosen) {
    const Direction& nearest = front[core::nearest_indices(front, d, 1).front()];
    REQUIRE(core::angle_radians(nearest, d) <= 2 * spacing);
    left += d.x() < 0 ? 1 : 0;
  }
  CHECK(left > 1350);  // half of them, within 5 standard deviations
  CHECK(left < 1650);
  CHECK(model::off_grid_directions(front, 0, 7).empty());
  CHECK(model::off_grid_directions(std::vector<Direction>{Direction()}, 5, 1).size() == 5);
  CHECK_THROWS_AS(model::off_grid_directions({}, 5, 1), core::BadInput);
  const std::vector<Direction> speck{Direction(), Direction::from_vector({1e-5, 0, 1})};
  CHECK_THROWS_AS(model::off_grid_directions(speck, 5, 1), core::BadInput);
}

TEST_CASE(
    "on a real subject rbf predicts a left-out light better than blending, and blending better than the "
    "nearest") {
  const auto folder = test::real_data("loewenkopf240");
  if (folder.empty()) SKIP_TEST("no real photographs here");
  std::vector<core::Light> lights;
  std::vector<std::filesystem::path> files;
  for (const core::LpEntry& entry : core::read_lp(folder / "dirs.lp")) {
    lights.push_back({entry.direction, {}, {1, 1, 1}});
    files.push_back(folder / entry.name);
  }
  const core::OlatScan scan("lion", lights, core::read_image_size(files[0]), {},
                            [files](std::size_t i) { return core::read_image(files[i]); });
  model::MethodOptions options;
  options.domain = model::Domain::kLinear;
  const auto scores =
      held_out(scan, {method("nearest", options), method("linear", options), method("rbf", options)}, 8, true);
  REQUIRE(scores[0].images == 30);
  CHECK(scores[2].rmse < 0.95 * scores[1].rmse);
  CHECK(scores[1].rmse < 0.9 * scores[0].rmse);
}

}  // namespace lightstage
