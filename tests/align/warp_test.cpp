#include <catch2/catch.hpp>
#include <limits>
#include <opencv2/imgproc.hpp>

#include "align/flow.h"
#include "align/moving_pictures.h"
#include "core/error.h"
#include "core/parallel.h"

namespace lightstage::align {

namespace {

FlowField constant_flow(int height, int width, float dx, float dy) {
  return test::flow_of([&](double, double) { return std::pair{double(dx), double(dy)}; }, height, width);
}

}  // namespace

TEST_CASE("no flow changes nothing, bit for bit") {
  for (const auto& [height, width] : {std::pair{1, 1}, {3, 17}, {31, 2}, {13, 23}}) {
    core::Image picture(height, width, 3);
    for (std::size_t i = 0; i < picture.values().size(); ++i) picture.values()[i] = float(std::sin(double(i)) * 1e5);
    CHECK(warp(picture, core::Image(height, width, 2)) == picture);
  }
}

TEST_CASE("a whole pixel of flow fetches the neighbour, and nothing from outside") {
  core::Image picture(5, 7, 1);
  for (std::size_t i = 0; i < picture.values().size(); ++i) picture.values()[i] = float(i + 1);
  const core::Image moved = warp(picture, constant_flow(5, 7, 2, -1));
  for (int y = 0; y < 5; ++y) {
    for (int x = 0; x < 7; ++x) {
      const bool from_inside = x + 2 < 7 && y - 1 >= 0;
      CHECK(moved(y, x) == (from_inside ? picture(y - 1, x + 2) : 0.0F));
    }
  }
}

TEST_CASE("waves of six pixels and more are interpolated to half a percent") {
  for (const double wavelength : {6.0, 8.0, 12.0, 20.0}) {
    const auto wave = [&](double x) { return 2 + std::sin(2 * 3.14159265358979 * x / wavelength + 0.3); };
    double squares = 0;
    int count = 0;
    for (float shift = 0.05F; shift < 1; shift += 0.1F) {
      core::Image along(9, 64, 1), down(64, 9, 1);
      for (int i = 0; i < 64; ++i) {
        for (int k = 0; k < 9; ++k) along(k, i) = down(i, k) = float(wave(i));
      }
      const core::Image moved_along = warp(along, constant_flow(9, 64, shift, 0));
      const core::Image moved_down = warp(down, constant_flow(64, 9, 0, shift));
      for (int i = 2; i < 61; ++i) {
        CHECK(moved_along(4, i) == Approx(moved_down(i, 4)).epsilon(1e-6));
        squares += std::pow(double(moved_along(4, i)) - wave(i + double(shift)), 2);
        ++count;
      }
    }
    CHECK(std::sqrt(squares / count) < 0.005);
  }
}

TEST_CASE("even pictures stay even") {
  core::Image picture(15, 18, 2);
  for (float& v : picture.values()) v = 0.1F;
  const core::Image moved = warp(picture, constant_flow(15, 18, 0.31F, -0.47F));
  for (int y = 1; y < 15; ++y) {
    for (int x = 0; x < 17; ++x) CHECK(moved(y, x, 1) == Approx(0.1).epsilon(1e-6));
  }
}

TEST_CASE("OpenCV's bicubic remap comes to the same picture, a little less exactly") {
  const test::Texture texture(3);
  const core::Image picture = test::picture_of(texture, 61, 67);
  const test::Motion motion = [](double x, double y) { return std::pair{std::sin(y / 9), 0.8 * std::cos(x / 7)}; };
  const FlowField flow = test::flow_of(motion, 61, 67);
  const core::Image ours = warp(picture, flow);
  cv::Mat_<float> from(61, 67), map_x(61, 67), map_y(61, 67), theirs;
  for (int y = 0; y < 61; ++y) {
    for (int x = 0; x < 67; ++x) {
      from(y, x) = picture(y, x);
      map_x(y, x) = float(x) + flow(y, x, 0);
      map_y(y, x) = float(y) + flow(y, x, 1);
    }
  }
  cv::remap(from, theirs, map_x, map_y, cv::INTER_CUBIC, cv::BORDER_REPLICATE);
  double ours_squares = 0, theirs_squares = 0, apart = 0;
  for (int y = 4; y < 57; ++y) {
    for (int x = 4; x < 63; ++x) {
      const auto [dx, dy] = motion(x, y);
      const double truth = texture(x + dx, y + dy);
      ours_squares += std::pow(double(ours(y, x)) - truth, 2);
      theirs_squares += std::pow(double(theirs(y, x)) - truth, 2);
      apart = std::max(apart, std::abs(double(ours(y, x)) - double(theirs(y, x))));
    }
  }
  CHECK(apart < 0.05);
  CHECK(ours_squares < theirs_squares);
}

TEST_CASE("dark pixels next to a highlight stay non-negative, and the highlight does not grow by more than a tenth") {
  core::Image picture(21, 21, 1);
  picture(10, 10) = 1e5F;
  for (float shift = -1; shift <= 1; shift += 0.1F) {
    const core::Image moved = warp(picture, constant_flow(21, 21, shift, 0.37F));
    for (const float v : moved.values()) {
      CHECK(v >= 0);
      CHECK(v <= 1.1e5F);
    }
  }
}

TEST_CASE("warping gives the same picture on any number of threads") {
  const core::Image picture = test::picture_of(test::Texture(5), 101, 53);
  const FlowField flow = test::flow_of([](double x, double y) { return std::pair{y / 30, x / 40}; }, 101, 53);
  core::set_thread_count(1);
  const core::Image one = warp(picture, flow);
  core::set_thread_count(5);
  const core::Image five = warp(picture, flow);
  core::set_thread_count(0);
  CHECK(one == five);
}

TEST_CASE("a flow that does not fit is refused") {
  const core::Image picture(8, 9, 3);
  CHECK_THROWS_AS(warp(picture, core::Image(8, 8, 2)), core::BadInput);
  CHECK_THROWS_AS(warp(picture, core::Image(8, 9, 3)), core::BadInput);
  FlowField flow(8, 9, 2);
  flow(2, 2, 1) = std::numeric_limits<float>::quiet_NaN();
  CHECK_THROWS_AS(warp(picture, flow), core::BadInput);
  // However far outside.
  flow(2, 2, 1) = 3e38F;
  CHECK(warp(picture, flow)(2, 2) == 0);
}

}  // namespace lightstage::align
