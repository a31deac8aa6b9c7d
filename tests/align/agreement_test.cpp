#include "align/agreement.h"

#include <catch2/catch.hpp>

#include "align/moving_pictures.h"
#include "core/error.h"

namespace lightstage::align {

namespace {

constexpr int kSize = 192;

// Somebody who sways by a few pixels; `edit` is done to the subject before it moves.
class Sitting {
 public:
  core::Image key() const { return test::noisy(test::picture_of(texture_, kSize, kSize), 0.3, 1); }

  static test::Motion sway(int frame, double px = 3) {
    return [=](double x, double) {
      return std::pair{px * std::sin(frame * 0.9) + 0.01 * x, px * std::cos(frame * 0.7)};
    };
  }
  core::Image frame(int index, double px = 3) const {
    return test::noisy(test::moved_picture_of(texture_, kSize, kSize, sway(index, px)), 0.3, 10 + std::uint64_t(index));
  }

 private:
  test::Texture texture_{5};
};

Agreement agreement(const core::Image& key, const core::Image& frame) {
  const FlowField there = compute_flow(key, frame, FlowPreset::kFine);
  return agreement_of(key, frame, there, flow_confidence(there, compute_flow(frame, key, FlowPreset::kFine)), {});
}

// An eye that closes: an ellipse takes an even value, 24 x 10 pixels of 192, as an eye of a head that fills the picture.
void close_eye(core::Image& picture) {
  for (int y = 60; y < 70; ++y)
    for (int x = 50; x < 74; ++x) {
      const double dx = (x - 61.5) / 12, dy = (y - 64.5) / 5;
      if (dx * dx + dy * dy <= 1) picture(y, x) = 0.8F;
    }
}

}  // namespace

TEST_CASE("swaying raises no alarm, a blink, a stranger and a leap do") {
  const Sitting sitting;
  const core::Image key = sitting.key();
  std::vector<Agreement> frames;
  for (int i = 1; i <= 8; ++i) frames.push_back(agreement(key, sitting.frame(i)));
  for (const std::string& objection : objections(frames, kSize)) CHECK(objection.empty());
  for (const Agreement& frame : frames) CHECK(frame.believed > 0.9);

  core::Image blink = sitting.frame(3);
  close_eye(blink);
  frames[2] = agreement(key, blink);
  frames[5] = agreement(key, test::noisy(test::picture_of(test::Texture(99), kSize, kSize), 0.3, 77));
  const std::vector<std::string> found = objections(frames, kSize);
  CHECK(found[2] == "changed in places, as by a blink or an expression");
  CHECK_FALSE(found[5].empty());
  CHECK(found[5] != found[2]);
  for (const std::size_t i : {0, 1, 3, 4, 6, 7}) CHECK(found[i].empty());
}

TEST_CASE("motion farther than can be undone is refused, farther in larger pictures") {
  Agreement frame;
  frame.motion_px = 40;
  CHECK(objections(std::vector{frame}, 1024).front() == "moved 40 px, farther than the 32 px that can be undone");
  CHECK(objections(std::vector{frame}, 4096).front().empty());
  frame.motion_px = 30;
  CHECK(objections(std::vector{frame}, 256).front().empty());
  frame.believed = 0.2;
  CHECK(objections(std::vector{frame}, 256).front() == "cannot be followed: only 20 % of the subject is found again");
  CHECK(objections({}, 256).empty());
}

TEST_CASE("what moves by 40 pixels is never taken for aligned") {
  const Sitting sitting;
  const core::Image key = sitting.key();
  std::vector<Agreement> frames;
  for (int i = 1; i <= 4; ++i) frames.push_back(agreement(key, sitting.frame(i)));
  const test::Motion leap = [](double, double) { return std::pair{32.0, 24.0}; };
  frames.push_back(agreement(key, test::noisy(test::moved_picture_of(test::Texture(5), kSize, kSize, leap), 0.3, 3)));
  const std::vector<std::string> found = objections(frames, kSize);
  CHECK_FALSE(found[4].empty());
  for (std::size_t i = 0; i < 4; ++i) CHECK(found[i].empty());
}

TEST_CASE(
    "a key frame that shows nothing is refused, and frames that resemble it in nothing are, be they ever so few") {
  const core::Image key = Sitting().key();
  CHECK(key_objection(key, {}, 0).empty());
  CHECK(key_objection(key, {}, 2).empty());
  core::Image even(40, 50, 3);
  CHECK(key_objection(even, {}, 1) == "is black");
  for (float& value : even.values()) value = -0.5F;
  CHECK(key_objection(even, {}, 1) == "is black");
  for (float& value : even.values()) value = 0.4F;
  CHECK(key_objection(even, {}, 1) == "shows nothing to follow: it is even");
  // A white-out before a dark background.
  core::Image mask(40, 50, 1);
  for (int y = 10; y < 30; ++y)
    for (int x = 10; x < 40; ++x) {
      mask(y, x) = 1;
      for (int c = 0; c < 3; ++c) even(y, x, c) = 1;
    }
  CHECK(key_objection(even, mask, 1) == "is saturated over 100 % of the subject");
  CHECK(key_objection(even, mask, 0).empty());
  CHECK(key_objection(even, {}, 1).empty());

  Agreement unlike;
  unlike.residual = 0.5;
  CHECK(objections(std::vector{unlike}, 256).front() == "does not resemble the key frame");
}

TEST_CASE("a subject without texture, a black one and one off the mask agree with themselves") {
  core::Image even(40, 50, 1), certain(40, 50, 1);
  std::fill(certain.values().begin(), certain.values().end(), 1.0F);
  const FlowField still(40, 50, 2);
  const Agreement black = agreement_of(even, even, still, certain, {});
  CHECK(black.residual == 0);
  std::fill(even.values().begin(), even.values().end(), 0.4F);
  const Agreement grey = agreement_of(even, even, still, certain, {});
  CHECK(grey.residual == 0);
  CHECK(grey.believed == 1);
  const Agreement nowhere = agreement_of(even, even, still, core::Image(40, 50, 1), core::Image(40, 50, 1));
  CHECK(nowhere.believed == 1);
  for (const std::string& objection : objections(std::vector{black, grey, nowhere, grey}, 50)) CHECK(objection.empty());
  CHECK_THROWS_AS(agreement_of(even, even, still, core::Image(40, 49, 1), {}), core::BadInput);
}

}  // namespace lightstage::align
