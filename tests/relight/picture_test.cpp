#include "relight/picture.h"

#include <catch2/catch.hpp>

#include "core/display.h"
#include "core/error.h"
#include "core/image_file.h"
#include "support/support.h"

namespace lightstage {

namespace {

core::Image ramp() {
  core::Image image(2, 50, 3);
  for (std::size_t i = 0; i < image.values().size(); ++i) image.values()[i] = float(i) * 0.01f;
  return image;
}

}  // namespace

TEST_CASE("a picture is written as EXR with its light and as PNG at the exposure asked for") {
  const test::TemporaryFolder folder;
  core::Image image = ramp();
  image(0, 0, 0) = 1e6f;  // beyond half floats
  image(0, 0, 1) = -0.25f;
  const relight::WrittenPicture written = relight::write_picture(folder / "face.exr", image, -1);
  CHECK(written.exr == folder / "face.exr");
  CHECK(written.png == folder / "face.png");
  const core::Image light = core::read_image(written.exr);
  CHECK(light(0, 0, 0) == 65504);
  CHECK(light(0, 0, 1) == -0.25f);
  CHECK(light(1, 20, 2) == Approx(image(1, 20, 2)).epsilon(1e-3));
  const core::Image shown = core::read_image(written.png, {core::Encoding::kLinear});
  CHECK(shown(0, 0, 0) == 1);
  CHECK(shown(0, 0, 1) == 0);
  for (int x = 1; x < 50; ++x)
    CHECK(shown(0, x, 0) == Approx(core::srgb_encode(std::min(1.0f, image(0, x, 0) / 2))).margin(0.6 / 255));
}

TEST_CASE("a picture's name ends in .exr and its folder exists") {
  const test::TemporaryFolder folder;
  CHECK_THROWS_AS(relight::write_picture(folder / "face.png", ramp(), 0), core::UsageError);
  CHECK_THROWS_AS(relight::write_picture(folder / "face", ramp(), 0), core::UsageError);
  CHECK_THROWS_AS(relight::write_picture(folder / "face.exr", ramp(), std::nan("")), core::UsageError);
  CHECK_THROWS_AS(relight::write_picture(folder / "absent" / "face.exr", ramp(), 0), core::BadInput);
  CHECK(std::filesystem::is_empty(folder.path()));
}

TEST_CASE("the automatic exposure brings the 99.5th percentile of the masked values to 1") {
  core::Image image(10, 200, 1);
  for (std::size_t i = 0; i < image.values().size(); ++i) image.values()[i] = 0.25f;
  image(3, 3) = 1000;  // one of 2000: not counted
  CHECK(relight::auto_exposure_stops(image, {}) == Approx(2));
  core::Image mask(10, 200, 1);
  mask(5, 5) = 1;
  image(5, 5) = 8;
  CHECK(relight::auto_exposure_stops(image, mask) == Approx(-3));
  CHECK(relight::auto_exposure_stops(core::expose(image, 1.5), mask) == Approx(-4.5));
}

TEST_CASE("the automatic exposure of extremes is finite") {
  CHECK(relight::auto_exposure_stops(core::Image(4, 4, 3), {}) == 0);
  core::Image faint(1, 1, 1);
  faint(0, 0) = 1e-42f;
  CHECK(relight::auto_exposure_stops(faint, {}) == 100);
  faint(0, 0) = -1;
  CHECK(relight::auto_exposure_stops(faint, {}) == 0);
  CHECK_THROWS_AS(relight::auto_exposure_stops(faint, core::Image(1, 1, 1)), core::BadInput);
  CHECK_THROWS_AS(relight::auto_exposure_stops(faint, core::Image(2, 1, 1)), core::BadInput);
  faint(0, 0) = std::nanf("");
  CHECK_THROWS_AS(relight::auto_exposure_stops(faint, {}), core::BadInput);
}

}  // namespace lightstage
