// Finding one highlight, in all the ways in which pictures go wrong.
#include <catch2/catch.hpp>
#include <limits>

#include "calib/ball_pictures.h"
#include "calib/mirror_ball.h"
#include "core/error.h"
#include "core/parallel.h"

namespace lightstage::calib {

namespace {

constexpr int kPixels = 240;
const Sphere kBall{{0, 0, 0}, 0.06, 0, 0};

core::CameraModel camera() {
  return test::stage_camera(kPixels);
}

// A round spot of radiance `peak` with a Gaussian profile, on black.
core::Image gaussian_spot(core::Pixel at, double peak, double sigma) {
  core::Image image(kPixels, kPixels, 1);
  for (int y = 0; y < kPixels; ++y) {
    for (int x = 0; x < kPixels; ++x) {
      const double r2 = (x - at.x) * (x - at.x) + (y - at.y) * (y - at.y);
      image(y, x) = float(peak * std::exp(-0.5 * r2 / (sigma * sigma)));
    }
  }
  return image;
}

double error_px(const std::optional<Highlight>& found, core::Pixel truth) {
  REQUIRE(found);
  return std::hypot(found->position.x - truth.x, found->position.y - truth.y);
}

}  // namespace

TEST_CASE("a highlight is found to a few hundredths of a pixel, clipped or not") {
  for (const double peak : {0.5, 5.0, 500.0, 50000.0}) {
    for (const double sigma : {0.6, 1.0, 1.8}) {
      std::vector<double> errors;
      for (int i = 0; i < 20; ++i) {
        const core::Pixel truth{118 + 0.37 * i, 131 - 0.23 * i};
        const core::Image image = test::through_sensor(gaussian_spot(truth, peak, sigma), 1, std::uint64_t(i));
        const auto found = find_highlight(image, camera(), kBall, 1);
        errors.push_back(error_px(found, truth));
        CHECK(found->clipped == (peak > 0.97));
        CHECK(errors.back() < 5 * found->sigma_px);
      }
      INFO("peak " << peak << ", sigma " << sigma << ": largest error " << test::percentile(errors, 1));
      CHECK(test::median(errors) < 0.05);
      CHECK(test::percentile(errors, 1) < 0.12);
    }
  }
}

TEST_CASE("the clipping level need not be known") {
  const core::Pixel truth{121.3, 117.8};
  core::Image image = gaussian_spot(truth, 1000, 1.2);
  for (float& v : image.values()) v = std::min(v, 1.0F);
  CHECK(error_px(find_highlight(image, camera(), kBall, 0), truth) < 0.1);
}

TEST_CASE("hot pixels, a dimmer spot and light outside the ball do not move the highlight") {
  const core::Pixel truth{104.4, 125.7};
  const core::Image spot = gaussian_spot(truth, 100, 0.8);
  const core::Image second = gaussian_spot({140, 110}, 8, 0.8);
  core::Image image = test::through_sensor(test::sum(spot, second), 1, 3);
  for (const auto& [y, x] : {std::pair{110, 120}, {90, 100}, {150, 131}, {124, 96}}) image(y, x) = 5;
  for (int y = 2; y < 8; ++y) {
    for (int x = 2; x < 8; ++x) image(y, x) = 50;
  }
  CHECK(error_px(find_highlight(image, camera(), kBall, 1), truth) < 0.1);
}

TEST_CASE("a streak through a clipped highlight hardly moves it") {
  const core::Pixel truth{112.0, 122.0};
  core::Image image = gaussian_spot(truth, 3000, 1.5);
  for (int y = 122; y < 150; ++y) {
    for (int x = 111; x <= 113; ++x) image(y, x) += 2.0F;
  }
  CHECK(error_px(find_highlight(test::through_sensor(image, 1, 4), camera(), kBall, 1), truth) < 0.6);
}

TEST_CASE("shading of the ball itself does not move the highlight") {
  const core::Pixel truth{127.25, 116.5};
  const core::Image shading = test::lambertian_ball(camera(), kBall, {{{0.9, 0.9, 0.8}, 0.012, 1}}, 0.5, 0.6);
  const core::Image image = test::through_sensor(test::sum(shading, gaussian_spot(truth, 0.4, 1.0)), 1, 5);
  CHECK(error_px(find_highlight(image, camera(), kBall, 1), truth) < 0.2);
}

TEST_CASE("where there is no highlight, none is found") {
  const core::Image black(kPixels, kPixels, 3);
  CHECK_FALSE(find_highlight(black, camera(), kBall, 1));
  core::Image white(kPixels, kPixels, 3);
  std::fill(white.values().begin(), white.values().end(), 1.0F);
  CHECK_FALSE(find_highlight(white, camera(), kBall, 1));
  for (std::uint64_t seed = 0; seed < 10; ++seed) {
    CHECK_FALSE(
        find_highlight(test::through_sensor(core::Image(kPixels, kPixels, 1), 0.9, seed), camera(), kBall, 1 / 0.9));
  }
  core::Image hot = test::through_sensor(core::Image(kPixels, kPixels, 1), 1, 9);
  hot(120, 117) = 1;
  CHECK_FALSE(find_highlight(hot, camera(), kBall, 1));
  // A dark frame brighter than the picture leaves negative values.
  core::Image negative = hot;
  for (float& v : negative.values()) v -= 0.2F;
  CHECK_FALSE(find_highlight(negative, camera(), kBall, 1));
  const core::Image shading = test::lambertian_ball(camera(), kBall, {{{0.9, 0.9, 0.8}, 0.012, 1}}, 0.5, 0.6);
  CHECK_FALSE(find_highlight(test::through_sensor(shading, 1, 6), camera(), kBall, 1));
  // A ball that is not in the picture.
  CHECK_FALSE(find_highlight(hot, camera(), Sphere{{0.5, 0, 0}, 0.06, 0, 0}, 1));
}

TEST_CASE("two spots of like strength, a spot at the border and a clipped ball are named as such") {
  const core::Image one = gaussian_spot({104.4, 125.7}, 0.6, 1.0);
  const core::Image both = test::sum(one, gaussian_spot({140, 110}, 0.5, 1.0));
  const LightEstimate doubled = estimate_light({0, test::through_sensor(both, 1, 3), 1}, camera(), kBall, 1.5);
  CHECK_FALSE(doubled.placed);
  CHECK(doubled.reason.starts_with("double"));
  REQUIRE(doubled.highlight);
  CHECK(doubled.highlight->rival == Approx(5.0 / 6).margin(0.1));
  const core::Image dimmer = test::sum(one, gaussian_spot({140, 110}, 0.1, 1.0));
  CHECK(estimate_light({0, test::through_sensor(dimmer, 1, 3), 1}, camera(), kBall, 1.5).placed);

  // The picture ends where the highlight is.
  core::CameraModel cropped = camera();
  constexpr int kLeft = 104;
  cropped.width -= kLeft;
  cropped.cx -= kLeft;
  const core::Image cut(one.view().crop(0, kLeft, kPixels, kPixels - kLeft));
  const LightEstimate at_border = estimate_light({0, test::through_sensor(cut, 1, 3), 1}, cropped, kBall, 1.5);
  CHECK_FALSE(at_border.placed);
  CHECK(at_border.reason.find("border") != std::string::npos);

  core::Image white(kPixels, kPixels, 1);
  std::fill(white.values().begin(), white.values().end(), 1.0F);
  CHECK(estimate_light({0, white, 1}, camera(), kBall, 1.5).reason.starts_with("overexposed"));
}

TEST_CASE("two lamps whose highlights touch are named, not placed in between") {
  const Sphere ball = kBall;
  const core::CameraModel big = test::stage_camera(800);  // the ball's image has a radius of 144 pixels
  const auto at = [](double longitude) {
    return test::Lamp{core::Direction::from_longitude_latitude_degrees(longitude, 12).vec() * 1.5, 0.03, 1};
  };
  const auto estimate = [&](const std::vector<test::Lamp>& lamps, double exposure) {
    const core::Image radiance = test::mirror_reflections(big, ball, lamps, 0.7);
    return estimate_light({0, test::through_sensor(radiance, exposure, 7), 1 / exposure}, big, ball, 1.5);
  };
  // Discs 2.3 degrees across: their images are 2.9 pixels across in the middle of the ball. Clipped ones that overlap more are one spot.
  for (const double longitude : {-40.0, 10.0, 55.0}) {
    for (const double exposure : {2e-4, 5e-3}) {
      const LightEstimate one = estimate({at(longitude)}, exposure);
      INFO("longitude " << longitude << ", exposure " << exposure << ": " << one.reason);
      CHECK(one.placed);
      const LightEstimate two = estimate({at(longitude), at(longitude + (exposure > 1e-3 ? 4.6 : 3.4))}, exposure);
      INFO("two: " << two.reason << (two.highlight ? two.highlight->rival : 0));
      CHECK_FALSE(two.placed);
      CHECK(two.reason.starts_with("double"));
    }
  }
}

TEST_CASE("single highlights of any size and place are not taken for two") {
  const core::CameraModel big = test::stage_camera(800);
  for (const double radius : {0.004, 0.012, 0.05, 0.1}) {
    for (int i = 0; i < 12; ++i) {
      const test::Lamp lamp{core::Direction::from_longitude_latitude_degrees(-100 + 17.3 * i, 40 - 9.1 * i).vec() * 1.5,
                            radius, 1};
      const core::Image radiance = test::mirror_reflections(big, kBall, {lamp}, 0.5);
      for (const double share : {0.4, 8.0, 300.0}) {
        const float peak = *std::max_element(radiance.values().begin(), radiance.values().end());
        const double exposure = share / double(peak);
        const auto found =
            find_highlight(test::through_sensor(radiance, exposure, std::uint64_t(i)), big, kBall, 1 / exposure);
        INFO("radius " << radius << ", light " << i << ", exposed " << share << " times");
        if (found) CHECK_FALSE(found->parted);
      }
    }
  }
}

TEST_CASE("lights two degrees apart are told apart") {
  const Sphere ball = kBall;
  std::vector<LightEstimate> found;
  std::vector<test::Lamp> lamps;
  for (const double longitude : {30.0, 32.0}) {
    lamps.push_back({core::Direction::from_longitude_latitude_degrees(longitude, 10).vec() * 1.5});
    const core::Image radiance = test::mirror_reflections(camera(), ball, {lamps.back()}, 0.6);
    found.push_back(
        estimate_light({0, test::through_sensor(radiance, 0.9, lamps.size()), 1 / 0.9}, camera(), ball, 1.5));
    REQUIRE(found.back().placed);
    CHECK(test::degrees_between(found.back().position, lamps.back().position) < 0.1);
  }
  CHECK(test::degrees_between(found[0].position, found[1].position) ==
        Approx(test::degrees_between(lamps[0].position, lamps[1].position)).margin(0.15));
}

TEST_CASE("a dead light is not placed, and why is said") {
  const core::Image dark = test::through_sensor(core::Image(kPixels, kPixels, 1), 1, 9);
  const LightEstimate estimate = estimate_light({7, dark, 1}, camera(), kBall, 1.5);
  CHECK(estimate.light_index == 7);
  CHECK_FALSE(estimate.placed);
  CHECK(estimate.reason == "no highlight on the ball");
}

TEST_CASE("a highlight at the rim says that it tells nothing") {
  // The ball's image has a radius of about 43 pixels.
  bool refused = false;
  for (double x = 119.5 + 40; x < 119.5 + 46; x += 0.25) {
    const core::Image image = test::through_sensor(gaussian_spot({x, 119.5}, 200, 0.7), 1, 8);
    const LightEstimate estimate = estimate_light({0, image, 1}, camera(), kBall, 1.5);
    if (estimate.placed) CHECK(estimate.sigma_degrees <= kLargestSigmaDegrees);
    if (!estimate.placed) CHECK_FALSE(estimate.reason.empty());
    refused = refused || !estimate.placed;
  }
  CHECK(refused);
}

TEST_CASE("a clipped highlight that reaches beyond the rim is not drawn inwards") {
  for (const double x : {155.3, 158.8, 161.6}) {
    const core::Pixel truth{x, 121.4};
    const core::Image image = test::through_sensor(gaussian_spot(truth, 50000, 0.9), 1, 3);
    CHECK(error_px(find_highlight(image, camera(), kBall, 1), truth) < 0.1);
  }
}

TEST_CASE("pictures that cannot be right are refused") {
  core::Image image(kPixels, kPixels, 1);
  CHECK_THROWS_AS(find_highlight(core::Image(kPixels, kPixels - 1, 1), camera(), kBall, 1), core::BadInput);
  image(3, 4) = std::numeric_limits<float>::quiet_NaN();
  CHECK_THROWS_AS(find_highlight(image, camera(), kBall, 1), core::BadInput);
  image(3, 4) = 0;
  CHECK_THROWS_AS(find_highlight(image, camera(), Sphere{{0, 0, 1.9}, 0.06, 0, 0}, 1), core::BadInput);
  CHECK_THROWS_AS(estimate_light({0, image, 1}, camera(), kBall, 0.05), core::BadInput);
}

TEST_CASE("a highlight does not depend on the number of threads") {
  const core::Image image = test::through_sensor(gaussian_spot({118.2, 125.9}, 300, 0.9), 1, 2);
  core::set_thread_count(1);
  const auto one = find_highlight(image, camera(), kBall, 1);
  core::set_thread_count(7);
  const auto seven = find_highlight(image, camera(), kBall, 1);
  core::set_thread_count(0);
  REQUIRE((one && seven));
  CHECK(one->position.x == seven->position.x);
  CHECK(one->position.y == seven->position.y);
}

}  // namespace lightstage::calib
