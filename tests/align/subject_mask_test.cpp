#include "align/subject_mask.h"

#include <catch2/catch.hpp>
#include <limits>

#include "align/moving_pictures.h"
#include "core/error.h"

namespace lightstage::align {

namespace {

bool in_ellipse(int y, int x, double cy, double cx, double ry, double rx) {
  return std::pow((y - cy) / ry, 2) + std::pow((x - cx) / rx, 2) < 1;
}

double mean_of(const core::Image& mask) {
  double sum = 0;
  for (const float v : mask.values()) sum += double(v);
  return sum / double(mask.values().size());
}

}  // namespace

TEST_CASE("the mask is the subject, dark hair and eyes included, a highlight notwithstanding") {
  const test::Texture texture(4);
  core::Image picture(173, 149, 3);
  core::Image truth(173, 149, 1);
  for (int y = 0; y < 173; ++y) {
    for (int x = 0; x < 149; ++x) {
      if (!in_ellipse(y, x, 85, 70, 70, 50)) continue;
      truth(y, x) = 1;
      double value = 0.3 + 0.5 * texture(x, y);
      if (in_ellipse(y, x, 75, 50, 6, 9) || in_ellipse(y, x, 75, 90, 6, 9)) value = 0.0005;  // eyes
      if (y < 45) value *= 0.15;                                                             // hair
      if (in_ellipse(y, x, 90, 70, 2, 2)) value = 40;                                        // gloss
      for (int c = 0; c < 3; ++c) picture(y, x, c) = float(value);
    }
  }
  const core::Image mask = subject_mask(test::noisy(picture, 0.5, 1));
  std::size_t wrong = 0, inside = 0;
  for (std::size_t i = 0; i < mask.values().size(); ++i) {
    CHECK((mask.values()[i] == 0 || mask.values()[i] == 1));
    wrong += mask.values()[i] != truth.values()[i];
    inside += truth.values()[i] > 0;
  }
  INFO(wrong << " of " << inside << " pixels wrong");
  CHECK(double(wrong) < 0.03 * double(inside));
}

TEST_CASE("specks of the background are no subject, a hand beside the head is") {
  core::Image picture(120, 120, 1);
  for (int y = 0; y < 120; ++y) {
    for (int x = 0; x < 120; ++x) {
      if (in_ellipse(y, x, 60, 45, 40, 30) || in_ellipse(y, x, 60, 100, 15, 12)) picture(y, x) = 0.5F;
    }
  }
  for (int y = 3; y < 7; ++y) {
    for (int x = 3; x < 7; ++x) picture(y, x) = 0.5F;
  }
  const core::Image mask = subject_mask(picture);
  CHECK(mask(60, 45) == 1);
  CHECK(mask(60, 100) == 1);
  CHECK(mask(5, 5) == 0);
  CHECK(mask(60, 118) == 0);
}

TEST_CASE("a picture without a dark background is all subject") {
  CHECK(mean_of(subject_mask(core::Image(30, 20, 3))) == 1);
  core::Image flat(17, 19, 1);
  for (float& v : flat.values()) v = 0.7F;
  CHECK(mean_of(subject_mask(flat)) == 1);
  for (float& v : flat.values()) v = -0.7F;
  CHECK(mean_of(subject_mask(flat)) == 1);
  for (std::uint64_t seed = 0; seed < 5; ++seed) {
    CHECK(mean_of(subject_mask(test::noisy(core::Image(97, 128, 1), 1, seed))) == 1);
  }
  CHECK(mean_of(subject_mask(test::picture_of(test::Texture(8), 64, 64))) == 1);
  CHECK(mean_of(subject_mask(core::Image(1, 1, 3))) == 1);
  CHECK(subject_mask(core::Image()).empty());
  flat(3, 3) = std::numeric_limits<float>::quiet_NaN();
  CHECK_THROWS_AS(subject_mask(flat), core::BadInput);
}

}  // namespace lightstage::align
