#include "align/motion_track.h"

#include <catch2/catch.hpp>
#include <limits>

#include "align/moving_pictures.h"
#include "core/display.h"
#include "core/error.h"

namespace lightstage::align {

namespace {

FlowField filled(float dx, float dy, int height = 3, int width = 5) {
  return test::flow_of([&](double, double) { return std::pair{double(dx), double(dy)}; }, height, width);
}

}  // namespace

TEST_CASE("the motion is exact at tracking frames, linear between, at rest outside") {
  const std::vector<core::Nanoseconds> starts{0, -5'000'000'000, 4'000'000'000'000'000'000,
                                              std::numeric_limits<core::Nanoseconds>::min()};
  for (const core::Nanoseconds start : starts) {
    MotionTrack track;
    // In any order.
    track.add(start + 1000, filled(0.1F, 0.7F));
    track.add(start, filled(1.0F / 3, -2));
    track.add(start + 5000, filled(4.1F, 0.3F));
    CHECK(track.size() == 3);
    CHECK(track.at(start) == filled(1.0F / 3, -2));
    CHECK(track.at(start + 1000) == filled(0.1F, 0.7F));
    CHECK(track.at(start + 5000) == filled(4.1F, 0.3F));
    CHECK(track.at(start + 5001) == filled(4.1F, 0.3F));
    CHECK(track.at(std::numeric_limits<core::Nanoseconds>::max()) == filled(4.1F, 0.3F));
    CHECK(track.at(std::numeric_limits<core::Nanoseconds>::min()) == filled(1.0F / 3, -2));
    const FlowField between = track.at(start + 2000);
    CHECK(between(1, 2, 0) == Approx(0.75 * 0.1 + 0.25 * 4.1));
    CHECK(between(1, 2, 1) == Approx(0.75 * 0.7 + 0.25 * 0.3));
    // A nanosecond before a tracking frame it is nearly there.
    CHECK(track.at(start + 4999)(0, 0, 0) == Approx(4.1).epsilon(1e-3));
  }
}

TEST_CASE("the time between tracking frames may be as long as time is") {
  MotionTrack track;
  track.add(std::numeric_limits<core::Nanoseconds>::min(), filled(0, 0));
  track.add(std::numeric_limits<core::Nanoseconds>::max(), filled(8, -8));
  CHECK(track.at(0)(0, 0, 0) == Approx(4));
  CHECK(track.at(0)(2, 4, 1) == Approx(-4));
}

TEST_CASE("one tracking frame is the motion at all times") {
  MotionTrack track;
  track.add(77, filled(1, 2));
  CHECK(track.at(-1) == filled(1, 2));
  CHECK(track.at(1000) == filled(1, 2));
}

TEST_CASE("constant velocity is reproduced by both, constant acceleration by Catmull-Rom, at uneven times too") {
  const std::vector<core::Nanoseconds> times{0, 700, 2000, 2600, 5000, 7000};
  const core::Nanoseconds start = GENERATE(core::Nanoseconds(0), core::Nanoseconds(4'000'000'000'000'000'000));
  for (const Between between : {Between::kLinear, Between::kCatmullRom}) {
    for (const double acceleration : {0.0, 3e-7}) {
      const auto place = [&](double t) { return 1.5 + 2e-3 * t + 0.5 * acceleration * t * t; };
      for (const std::size_t count : {std::size_t(2), std::size_t(3), times.size()}) {
        if (count == 2 && acceleration != 0) continue;
        MotionTrack track(between);
        for (std::size_t i = 0; i < count; ++i) {
          track.add(start + times[i], filled(float(place(double(times[i]))), float(-2 * place(double(times[i])))));
        }
        double largest = 0;
        for (core::Nanoseconds t = 0; t <= times[count - 1]; t += 50) {
          const FlowField flow = track.at(start + t);
          largest = std::max({largest, std::abs(double(flow(1, 2, 0)) - place(double(t))),
                              std::abs(double(flow(1, 2, 1)) + 2 * place(double(t)))});
        }
        INFO("acceleration " << acceleration << ", tracking frames " << count << ", between " << int(between));
        if (acceleration == 0 || between == Between::kCatmullRom) {
          CHECK(largest < 1e-5);
        } else {
          CHECK(largest > 0.1);  // 2 * acceleration * 2400^2 / 8
        }
      }
    }
  }
}

TEST_CASE("Catmull-Rom reaches every tracking frame and is smooth there") {
  MotionTrack track(Between::kCatmullRom);
  const std::vector<float> places{0.5F, -1, 2.25F, 2, -0.75F};
  for (std::size_t i = 0; i < places.size(); ++i) track.add(core::Nanoseconds(i) * 10'000, filled(places[i], 0));
  for (std::size_t i = 0; i < places.size(); ++i) {
    const core::Nanoseconds t = core::Nanoseconds(i) * 10'000;
    CHECK(track.at(t)(0, 0, 0) == places[i]);
    if (i == 0 || i + 1 == places.size()) continue;
    const double before = double(track.at(t)(0, 0, 0) - track.at(t - 100)(0, 0, 0));
    const double after = double(track.at(t + 100)(0, 0, 0) - track.at(t)(0, 0, 0));
    CHECK(before == Approx(after).margin(2e-3));
  }
  CHECK(track.at(-1) == track.at(0));
  CHECK(track.at(50'000) == track.at(40'000));
}

TEST_CASE("a track that forgets what is past gives the same motion from there on") {
  for (const Between between : {Between::kLinear, Between::kCatmullRom}) {
    MotionTrack whole(between), streamed(between);
    for (int i = 0; i < 12; ++i) whole.add(i * 1000 + 37 * (i % 3), filled(float(i * i % 7), float(i % 5)));
    core::Nanoseconds next = 0;
    for (int i = 0; i < 12; ++i) {
      streamed.add(i * 1000 + 37 * (i % 3), filled(float(i * i % 7), float(i % 5)));
      const auto settled = i == 11 ? std::optional<core::Nanoseconds>(11'100) : streamed.settled_until();
      for (; settled && next <= *settled; next += 130) CHECK(streamed.at(next) == whole.at(next));
      streamed.forget_before(next);
      CHECK(streamed.size() <= 6);
    }
    CHECK(next > 11'000);
  }
}

TEST_CASE("confidence goes linearly from one tracking frame to the next") {
  MotionTrack track(Between::kCatmullRom);
  core::Image half(3, 5, 1);
  std::fill(half.values().begin(), half.values().end(), 0.5F);
  track.add(0, filled(0, 0));
  track.add(100, filled(1, 0), half);
  track.add(200, filled(3, 0), core::Image(3, 5, 1));
  CHECK(track.confidence_at(-5)(2, 4) == 1);
  CHECK(track.confidence_at(0)(2, 4) == 1);
  CHECK(track.confidence_at(50)(2, 4) == Approx(0.75));
  CHECK(track.confidence_at(100)(0, 0) == 0.5F);
  CHECK(track.confidence_at(150)(2, 4) == Approx(0.25));
  CHECK(track.confidence_at(300)(2, 4) == 0);
  CHECK_THROWS_AS(track.add(400, filled(1, 0), core::Image(3, 4, 1)), core::BadInput);
  CHECK_THROWS_AS(MotionTrack().confidence_at(0), core::BadInput);
}

TEST_CASE("a motion track refuses what does not belong") {
  MotionTrack track;
  CHECK_THROWS_AS(track.at(0), core::BadInput);
  track.add(5, filled(1, 2));
  CHECK_THROWS_AS(track.add(5, filled(1, 2)), core::BadInput);
  CHECK_THROWS_AS(track.add(6, filled(1, 2, 3, 4)), core::BadInput);
  CHECK_THROWS_AS(track.add(6, core::Image(3, 5, 3)), core::BadInput);
  FlowField bad = filled(0, 0);
  bad(0, 0) = std::numeric_limits<float>::quiet_NaN();
  CHECK_THROWS_AS(track.add(6, bad), core::BadInput);
  CHECK(track.size() == 1);
}

TEST_CASE("median motion is over the mask") {
  FlowField flow(2, 3, 2);
  flow(0, 0, 0) = 3;
  flow(0, 0, 1) = 4;
  core::Image mask(2, 3, 1);
  mask(0, 0) = 1;
  CHECK(median_motion_px(flow, mask) == 5);
  CHECK(median_motion_px(flow, {}) == 0);
  CHECK(median_motion_px(flow, core::Image(2, 3, 1)) == 0);
  CHECK_THROWS_AS(median_motion_px(flow, core::Image(3, 3, 1)), core::BadInput);
  CHECK_THROWS_AS(median_motion_px(core::Image(2, 3, 1), {}), core::BadInput);
}

TEST_CASE("what noise makes of a subject that stands still is told from motion") {
  const test::Texture texture(7);
  const core::Image reference = test::picture_of(texture, 128, 128);
  const auto found = [&](double dx) {
    const core::Image other = test::moved_picture_of(texture, 128, 128, [=](double, double) {
      return std::pair{dx, 0.0};
    });
    return compute_flow(test::noisy(reference, 0.4, 1), test::noisy(other, 0.4, 2));
  };
  CHECK(stands_still(found(0), {}));
  CHECK_FALSE(stands_still(found(0.05), {}));
  CHECK(stands_still(filled(0, 0), {}));
  CHECK(stands_still(filled(9, 0), core::Image(3, 5, 1)));
  CHECK_THROWS_AS(stands_still(filled(0, 0), core::Image(3, 4, 1)), core::BadInput);
}

TEST_CASE("the residual is measured on display-encoded values, over the mask, at the reference's exposure") {
  const core::Image a = test::picture_of(test::Texture(2), 40, 30);
  CHECK(residual(a, a, {}) == 0);
  core::Image b = a;
  for (float& v : b.values()) v *= 0.5F;
  core::Image a4 = a, b4 = b;
  for (float& v : a4.values()) v *= 4;
  for (float& v : b4.values()) v *= 4;
  CHECK(residual(a, b, {}) == Approx(residual(a4, b4, {})));
  CHECK(residual(a, b, {}) > 0.1);
  core::Image mask(40, 30, 1);
  mask(7, 9) = 1;
  core::Image one_off = a;
  one_off(8, 9) = 100;
  CHECK(residual(a, one_off, mask) == 0);
  // Against black: the encoded reference itself.
  core::Image flat(4, 4, 3), black(4, 4, 3);
  for (float& v : flat.values()) v = 0.3F;
  CHECK(residual(flat, black, {}) == Approx(1).epsilon(1e-5));
  CHECK(residual(black, black, {}) == 0);
  CHECK(residual(black, black, core::Image(4, 4, 1)) == 0);
  CHECK_THROWS_AS(residual(flat, core::Image(4, 4, 1), {}), core::BadInput);
}

}  // namespace lightstage::align
