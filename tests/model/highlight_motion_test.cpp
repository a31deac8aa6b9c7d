// Flow between highlights, and pictures moved along it.
#include "model/classical/highlight_motion.h"

#include <catch2/catch.hpp>

using namespace lightstage;
using core::Image;

namespace {

Image blob(double x0, double y0, double floor = 0) {
  Image image(80, 96, 3);
  for (int y = 0; y < 80; ++y)
    for (int x = 0; x < 96; ++x)
      for (int c = 0; c < 3; ++c)
        image(y, x, c) = float(floor + std::exp(-((x - x0) * (x - x0) + (y - y0) * (y - y0)) / (2 * 3.0 * 3.0)));
  return image;
}

Image shift(int height, int width, float dx, float dy) {
  Image displacement(height, width, 2);
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      displacement(y, x, 0) = dx;
      displacement(y, x, 1) = dy;
    }
  }
  return displacement;
}

}  // namespace

TEST_CASE("highlight flow: a highlight is followed, one without a counterpart is not") {
  const Image from = blob(40, 38), to = blob(51, 33);
  const Image flow = model::highlight_flow(from, to, 1);
  CHECK(flow(38, 40, 0) == Approx(11).margin(1));
  CHECK(flow(38, 40, 1) == Approx(-5).margin(1));
  const Image black(80, 96, 3);
  const Image gone = model::highlight_flow(from, black, 1), none = model::highlight_flow(from, from, 1);
  for (const float value : gone.values()) REQUIRE(std::abs(value) < 0.01F);
  for (const float value : none.values()) REQUIRE(value == 0);
  const Image tiny(3, 2, 3);
  CHECK(model::highlight_flow(tiny, tiny, 1) == Image(3, 2, 2));
}

TEST_CASE("moved: by nothing, by whole pixels, by half pixels, and out of the picture") {
  const Image picture = blob(40, 38);
  CHECK(model::moved(picture, shift(80, 96, 0, 0)) == picture);
  const Image right = model::moved(picture, shift(80, 96, 3, -2));
  for (int y = 0; y < 78; ++y)
    for (int x = 3; x < 96; ++x) REQUIRE(right(y, x, 1) == picture(y + 2, x - 3, 1));
  CHECK(right(40, 1, 0) == 0);
  const Image half = model::moved(picture, shift(80, 96, 0.5F, 0));
  CHECK(half(38, 40) == Approx((picture(38, 39) + picture(38, 40)) / 2));
  const Image away = model::moved(picture, shift(80, 96, 3e38F, -1e9F));
  for (const float value : away.values()) REQUIRE(value == 0);

  // Drawn apart by less than half: no holes.
  Image apart(80, 96, 2);
  for (int y = 0; y < 80; ++y)
    for (int x = 0; x < 96; ++x) apart(y, x, 0) = 0.4F * float(x - 40);
  const Image wide = model::moved(blob(40, 38, 0.5), apart);
  for (int x = 10; x < 70; ++x) REQUIRE(wide(38, x) > 0.45F);
}
