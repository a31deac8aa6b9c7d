// Error measures against values worked out by hand and against the definitions written out plainly.
#include <catch2/catch.hpp>
#include <cstdint>

#include "core/error.h"
#include "core/parallel.h"
#include "model/metric_pictures.h"
#include "model/metrics.h"

namespace lightstage {

namespace {

using core::Image;
using test::constant, test::mirrored, test::noise;

Image image_of(int height, int width, const std::vector<float>& values) {
  Image image(height, width, int(values.size()) / (height * width));
  std::copy(values.begin(), values.end(), image.values().begin());
  return image;
}

// SSIM of one pixel as its definition says, on values in [0, 1].
double plain_ssim(const Image& a, const Image& b, int y, int x, int c) {
  const auto [ma, mb, va, vb, ab] = test::plain_ssim_window(a, b, y, x, c);
  const double c1 = 0.01 * 0.01, c2 = 0.03 * 0.03;
  return (2 * ma * mb + c1) * (2 * ab + c2) / ((ma * ma + mb * mb + c1) * (va + vb + c2));
}

using Metric = double (*)(core::ImageView, core::ImageView, core::ImageView);
const std::vector<Metric> kMetrics{model::mean_squared_error, model::squared_h1, model::dssim, model::flip};

}  // namespace

TEST_CASE("the mean squared error of small pictures, by hand") {
  const Image a = image_of(1, 2, {0, 0.5f}), b = image_of(1, 2, {1, 0.25f});
  CHECK(model::mean_squared_error(a, b, {}) == Approx((1 + 0.0625) / 2));
  CHECK(model::mean_squared_error(a, b, image_of(1, 2, {0, 1})) == Approx(0.0625));
  CHECK(model::mean_squared_error(a, b, image_of(1, 2, {1, 0.5f})) == Approx(1));  // 0.5 is outside
  const Image rgb = image_of(1, 1, {0.1f, 0.2f, 0.3f});
  CHECK(model::mean_squared_error(rgb, constant(1, 1, 3, 0), {}) == Approx((0.01 + 0.04 + 0.09) / 3));
}

TEST_CASE("the H1 error of small pictures, by hand") {
  // e = 1 in one corner: 1 for the value, 1 for each of the two differences, over four pixels.
  const Image e = image_of(2, 2, {1, 0, 0, 0}), zero = constant(2, 2, 1, 0);
  CHECK(model::squared_h1(e, zero, {}) == Approx(3.0 / 4));
  // Without the right neighbour: one value and one difference over three pixels.
  CHECK(model::squared_h1(e, zero, image_of(2, 2, {1, 0, 1, 1})) == Approx(2.0 / 3));
  // In the opposite corner the differences are those of its neighbours.
  CHECK(model::squared_h1(image_of(2, 2, {0, 0, 0, 1}), zero, {}) == Approx(3.0 / 4));
  // A constant error has no gradient; a ramp of 0.5 a pixel has 0.25 for every pair.
  CHECK(model::squared_h1(constant(3, 4, 3, 0.5f), constant(3, 4, 3, 0.25f), {}) == Approx(0.0625));
  CHECK(model::squared_h1(image_of(1, 3, {0, 0.5f, 1}), constant(1, 3, 1, 0), {}) ==
        Approx((0.25 + 1 + 0.25 + 0.25) / 3));
  CHECK(model::squared_h1(constant(1, 1, 1, 0.5f), constant(1, 1, 1, 0), {}) == Approx(0.25));
}

TEST_CASE("the DSSIM of constant pictures, by hand") {
  // No variance: SSIM = (2 a b + C1)/(a^2 + b^2 + C1), C1 = 1e-4.
  const auto expected = [](double a, double b) { return (1 - (2 * a * b + 1e-4) / (a * a + b * b + 1e-4)) / 2; };
  for (const int n : {1, 2, 5, 11, 30}) {
    CHECK(model::dssim(constant(n, n, 1, 0), constant(n, n, 1, 1), {}) == Approx(expected(0, 1)).margin(1e-9));
    CHECK(model::dssim(constant(n, 2 * n, 3, 0.25f), constant(n, 2 * n, 3, 0.75f), {}) ==
          Approx(expected(0.25, 0.75)).margin(1e-9));
  }
}

TEST_CASE("DSSIM is the mean over the mask of the definition written out, smaller than the window too") {
  for (const core::ImageSize size : {core::ImageSize{1, 1, 3}, {1, 9, 1}, {3, 7, 3}, {13, 11, 3}, {40, 33, 1}}) {
    const Image a = noise(size, 1);
    Image b = noise(size, 2);
    for (std::size_t i = 0; i < b.values().size(); ++i) b.values()[i] = 0.7f * a.values()[i] + 0.3f * b.values()[i];
    Image mask(size.height, size.width, 1);
    double sum = 0;
    int count = 0;
    for (int y = 0; y < size.height; ++y)
      for (int x = 0; x < size.width; ++x) {
        if ((x + 2 * y) % 3 == 1) continue;
        mask(y, x) = 1;
        for (int c = 0; c < size.channels; ++c) {
          sum += (1 - plain_ssim(a, b, y, x, c)) / 2;
          ++count;
        }
      }
    CAPTURE(size.height, size.width, size.channels);
    CHECK(model::dssim(a, b, mask) == Approx(sum / count).margin(1e-9));
  }
}

TEST_CASE("DSSIM of a pattern and its negative is beyond one half, that of a hardly changed picture near 0") {
  Image a(32, 32, 1), b(32, 32, 1), c(32, 32, 1);
  for (int y = 0; y < 32; ++y)
    for (int x = 0; x < 32; ++x) {
      a(y, x) = float((x / 2 + y / 2) % 2);
      b(y, x) = 1 - a(y, x);
      c(y, x) = 0.02f + 0.96f * a(y, x);
    }
  CHECK(model::dssim(a, b, {}) > 0.9);
  CHECK(model::dssim(a, c, {}) < 0.002);
  CHECK(model::dssim(a, c, {}) > 0);
}

TEST_CASE("all error measures are 0 for equal pictures, symmetric, blind to mirroring and to the thread count") {
  for (const core::ImageSize size : {core::ImageSize{1, 1, 1}, {2, 3, 3}, {37, 53, 3}, {64, 64, 1}}) {
    const Image a = noise(size, 5), b = noise(size, 6);
    Image mask(size.height, size.width, 1);
    for (int y = 0; y < size.height; ++y)
      for (int x = 0; x < size.width; ++x) mask(y, x) = (x * y) % 4 == 0 ? 1.0f : 0.0f;
    for (const Metric metric : kMetrics) {
      CHECK(metric(a, a, mask) == 0);
      const double error = metric(a, b, mask);
      CHECK(error > 0);
      CHECK(metric(b, a, mask) == Approx(error).epsilon(1e-12));
      CHECK(metric(mirrored(a), mirrored(b), mirrored(mask)) == Approx(error).epsilon(1e-7));
      for (const int threads : {1, 2, 5}) {
        core::set_thread_count(threads);
        CHECK(metric(a, b, mask) == error);
      }
      core::set_thread_count(0);
    }
  }
}

TEST_CASE("what lies outside the mask does not count for the squared and the H1 error") {
  const Image a = noise({16, 16, 3}, 7), b = noise({16, 16, 3}, 8);
  Image changed = b;
  Image mask(16, 16, 1);
  for (int y = 0; y < 16; ++y)
    for (int x = 0; x < 16; ++x) {
      mask(y, x) = x < 9 ? 1.0f : 0.0f;
      for (int c = 0; c < 3; ++c)
        if (x >= 9) changed(y, x, c) = 0.123f;
    }
  CHECK(model::mean_squared_error(a, b, mask) == model::mean_squared_error(a, changed, mask));
  CHECK(model::squared_h1(a, b, mask) == model::squared_h1(a, changed, mask));
}

TEST_CASE("error measures take windows of larger pictures") {
  const Image a = noise({20, 22, 3}, 9), b = noise({20, 22, 3}, 10);
  const core::ImageView part_a = a.view().crop(3, 4, 14, 13), part_b = b.view().crop(3, 4, 14, 13);
  const Image copy_a(part_a), copy_b(part_b);
  for (const Metric metric : kMetrics) CHECK(metric(part_a, part_b, {}) == metric(copy_a, copy_b, {}));
}

TEST_CASE("pictures or masks that do not fit and masks without a pixel are refused") {
  const Image a(4, 5, 3);
  for (const Metric metric : kMetrics) {
    CHECK_THROWS_AS(metric(a, Image(5, 4, 3), {}), core::BadInput);
    CHECK_THROWS_AS(metric(a, Image(4, 5, 1), {}), core::BadInput);
    CHECK_THROWS_AS(metric(a, a, Image(4, 4, 1)), core::BadInput);
    CHECK_THROWS_AS(metric(a, a, Image(4, 5, 1)), core::BadInput);  // all 0
    CHECK_THROWS_AS(metric(Image(), Image(), {}), core::BadInput);
  }
}

}  // namespace lightstage
