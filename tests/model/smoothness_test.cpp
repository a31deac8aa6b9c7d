// Numbers for how evenly pictures change while the light moves, on frames made by hand.
#include <catch2/catch.hpp>
#include <functional>

#include "core/error.h"
#include "model/smoothness.h"

namespace lightstage {

namespace {

using core::Image;
using Positions = std::vector<std::optional<double>>;

constexpr int kHeight = 5, kWidth = 60;

Image constant(float value) {
  Image image(2, 3, 3);
  std::fill(image.values().begin(), image.values().end(), value);
  return image;
}

// Frames whose rows 1 to 3 are dark up to x(t) + row and bright beyond it, over a ramp of two pixels; a still edge of the subject stands at 50.
std::vector<Image> moving_shadow(int frames, const std::function<double(int)>& x) {
  std::vector<Image> result;
  for (int t = 0; t < frames; ++t) {
    Image image(kHeight, kWidth, 1);
    for (int row = 0; row < kHeight; ++row)
      for (int u = 0; u < kWidth; ++u) {
        const double lit = row == 0 || row == 4 ? 0.7 : std::clamp((u - x(t) - row) / 2 + 0.5, 0.0, 1.0);
        image(row, u) = float((0.1 + 0.6 * lit) * (u >= 50 ? 0.3 : 1));
      }
    result.push_back(std::move(image));
  }
  return result;
}

Positions positions(const std::vector<Image>& frames, const model::ShadowEdge& edge, double reach) {
  Positions found;
  for (std::size_t t = 0; t < frames.size(); ++t) {
    found.push_back(model::edge_near(frames[t].view().crop(edge.row, 0, 1, frames[t].width()), edge, t, reach));
  }
  return found;
}

}  // namespace

TEST_CASE("frames that change evenly have no second difference, a jump has its own size") {
  model::SecondDifferences even, jump;
  for (const float v : {0.1f, 0.2f, 0.3f, 0.4f}) even.add(constant(v), {});
  CHECK(even.largest() == Approx(0).margin(1e-7));
  CHECK(even.mean() == Approx(0).margin(1e-7));
  for (const float v : {0.1f, 0.1f, 0.5f, 0.5f}) jump.add(constant(v), {});
  CHECK(jump.largest() == Approx(0.4));
  CHECK(jump.mean() == Approx(0.4));  // at both frames beside the jump
  jump.add(constant(0.5f), {});
  jump.add(constant(0.3f), {});
  CHECK(jump.largest() == Approx(0.4));
  CHECK(jump.mean() == Approx((0.4 + 0.4 + 0 + 0.2) / 4));
}

TEST_CASE("second differences are the root of the mean square over the mask alone") {
  Image mask(2, 3, 1);
  mask(0, 0) = mask(1, 2) = 1;
  model::SecondDifferences differences;
  for (int t = 0; t < 3; ++t) {
    Image frame = constant(t == 1 ? 0.9f : 0.1f);
    frame(0, 0, 0) = frame(0, 0, 1) = frame(0, 0, 2) = 0.2f;
    for (int c = 0; c < 3; ++c) frame(1, 2, c) = t == 1 ? 0.5f : 0.3f;
    differences.add(std::move(frame), mask);
  }
  CHECK(differences.largest() == Approx(std::sqrt(0.4 * 0.4 / 2)));
  CHECK_THROWS_AS(differences.add(Image(3, 2, 3), mask), core::BadInput);
  CHECK(model::SecondDifferences().mean() == 0);
}

TEST_CASE("a slanted straight shadow edge is found, and its line has the slope it was drawn with and no residual") {
  const auto frames = moving_shadow(30, [](int t) { return 10.3 + 0.8 * t; });
  const auto edge = model::find_moving_edge(frames, {});
  REQUIRE(edge);
  CHECK(edge->sign == 1);
  CHECK(edge->row >= 1);
  CHECK(edge->row <= 3);
  const auto fit = model::fit_line(positions(frames, *edge, 5));
  REQUIRE(fit);
  CHECK(fit->frames == 30);
  CHECK(fit->slope == Approx(0.8).epsilon(1e-5));
  CHECK(fit->offset == Approx(10.3 + edge->row).epsilon(1e-5));
  CHECK(fit->residual == Approx(0).margin(1e-5));
}

TEST_CASE("an edge that jumps from light to light has the residual of its staircase") {
  const auto straight = moving_shadow(32, [](int t) { return 12.25 + 1.0 * t; });
  const auto edge = model::find_moving_edge(straight, {});
  REQUIRE(edge);
  // Steps of 4 frames about the straight line: the distances from it are -1.5, -0.5, 0.5, 1.5, of which the fitted line's slope takes a little.
  const auto stairs = moving_shadow(32, [](int t) { return 12.25 + 1.5 + 4 * (t / 4); });
  const Positions found = positions(stairs, *edge, 5);
  double tt = 0, te = 0, ee = 0;
  for (int t = 0; t < 32; ++t) {
    const double error = 1.5 - t % 4, time = t - 15.5;
    REQUIRE(found[std::size_t(t)]);
    CHECK(*found[std::size_t(t)] == Approx(12.25 + edge->row + t + error).margin(1e-4));
    tt += time * time;
    te += time * error;
    ee += error * error;
  }
  const auto fit = model::fit_line(found);
  CHECK(ee / 32 == Approx(1.25));
  CHECK(fit->slope == Approx(1 + te / tt).margin(1e-4));
  CHECK(fit->residual == Approx(std::sqrt(ee / 32 - te * te / tt / 32)).margin(1e-4));
  CHECK(fit->residual > 1.1);
}

TEST_CASE("only edges that move, inside the mask, in the same sense and within reach count") {
  const auto frames = moving_shadow(20, [](int t) { return 10 + 1.0 * t; });
  Image mask(kHeight, kWidth, 1);
  for (int row = 0; row < kHeight; ++row)
    for (int x = 0; x < kWidth; ++x) mask(row, x) = row == 2 ? 1.0f : 0.0f;
  const auto edge = model::find_moving_edge(frames, mask);
  REQUIRE(edge);
  CHECK(edge->row == 2);
  const std::vector<Image> still(5, frames[3]);
  CHECK_FALSE(model::find_moving_edge(still, {}));
  CHECK_FALSE(model::find_moving_edge(std::span(frames).first(2), {}));
  const auto ahead = moving_shadow(20, [](int t) { return 16 + 1.0 * t; });
  CHECK_FALSE(model::fit_line(positions(ahead, *edge, 4)));
  CHECK(model::fit_line(positions(ahead, *edge, 7))->offset == Approx(18).epsilon(1e-4));
  const std::vector<Image> thin(4, Image(3, 1, 1));
  CHECK_FALSE(model::find_moving_edge(thin, {}));
}

TEST_CASE("a line is fitted through the frames that have an edge") {
  CHECK_FALSE(model::fit_line(Positions{}));
  CHECK_FALSE(model::fit_line(Positions{{}, 3.0, {}}));
  const auto fit = model::fit_line(Positions{1.0, {}, {}, 7.0, {}, 11.0});
  CHECK(fit->slope == Approx(2));
  CHECK(fit->offset == Approx(1));
  CHECK(fit->residual == Approx(0).margin(1e-12));
  CHECK(fit->frames == 3);
}

}  // namespace lightstage
