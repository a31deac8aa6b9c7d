#include "align/hidden.h"

#include <catch2/catch.hpp>

#include "align/moving_pictures.h"
#include "core/error.h"

namespace lightstage::align {

namespace {

core::Image even(float value, int channels = 1) {
  core::Image image(6, 5, channels);
  std::fill(image.values().begin(), image.values().end(), value);
  return image;
}

}  // namespace

TEST_CASE("what is hidden is predicted from the pictures that show it, as bright as this one") {
  core::Image picture = even(2, 3), dimmer = even(0.5F, 3), confidence = even(1), seen = even(1), mask = even(1);
  confidence(2, 2) = confidence(3, 3) = confidence(5, 4) = 0;
  mask(5, 4) = 0;
  HiddenPixels hidden(confidence, mask);
  CHECK(hidden.count() == 2);
  CHECK(hidden.share() == Approx(2.0 / 29));
  // Twice as bright at one of the places; that hides the other one itself.
  for (int c = 0; c < 3; ++c) dimmer(2, 2, c) = 1;
  core::Image other = even(1);
  other(3, 3) = 0;
  hidden.add(picture, confidence, dimmer, other, mask, 0.5);
  hidden.add(picture, confidence, even(8, 3), other, mask, 1.5);
  hidden.add(picture, confidence, even(0, 3), even(1), mask, 7);  // black: says nothing
  hidden.fill(picture, seen);
  for (int c = 0; c < 3; ++c) {
    CHECK(picture(2, 2, c) == Approx((0.5 * 4 + 1.5 * 2) / 2));
    CHECK(picture(3, 3, c) == 0);
    CHECK(picture(5, 4, c) == 2);
    CHECK(picture(0, 0, c) == 2);
  }
  CHECK(seen(2, 2) == 1);
  CHECK(seen(3, 3) == 0);
  CHECK(seen(5, 4) == 1);
}

TEST_CASE("hidden pixels at the extremes") {
  core::Image picture = even(2), nothing = even(0), seen = even(1);
  // All of it hidden: nothing to compare brightness by.
  HiddenPixels all(nothing, {});
  CHECK(all.share() == 1);
  all.add(picture, nothing, even(3), even(1), {}, 1);
  core::Image filled = picture;
  all.fill(filled, seen);
  CHECK(filled == nothing);
  CHECK(seen == nothing);
  const HiddenPixels none(even(1), {});
  CHECK(none.count() == 0);
  none.fill(picture, seen);
  CHECK(picture == even(2));
  CHECK(HiddenPixels(nothing, nothing).share() == 0);
  HiddenPixels sound(nothing, {});
  CHECK_THROWS_AS(sound.add(picture, nothing, core::Image(6, 4, 1), even(1), {}, 1), core::BadInput);
  CHECK_THROWS_AS(sound.add(picture, nothing, even(1, 3), even(1), {}, 1), core::BadInput);
  CHECK_THROWS_AS(sound.add(picture, nothing, even(1), even(1), {}, 0), core::BadInput);
  CHECK_THROWS_AS(HiddenPixels(nothing, core::Image(6, 4, 1)), core::BadInput);
  CHECK_THROWS_AS(HiddenPixels(even(1, 2), {}), core::BadInput);
}

}  // namespace lightstage::align
