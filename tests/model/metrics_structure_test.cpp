// MS-SSIM and GMSD against values worked out by hand, their definitions written out plainly, and OpenCV.
#include <catch2/catch.hpp>
#include <cstdint>
#include <opencv2/quality/qualitygmsd.hpp>

#include "core/error.h"
#include "core/parallel.h"
#include "model/metric_pictures.h"
#include "model/metrics.h"

namespace lightstage {

namespace {

using core::Image;
using test::constant, test::mirrored, test::noise;

// Partly like `image`.
Image resembling(const Image& image, std::uint32_t seed) {
  Image result = noise(image.size(), seed);
  for (std::size_t i = 0; i < result.values().size(); ++i)
    result.values()[i] = 0.7f * image.values()[i] + 0.3f * result.values()[i];
  return result;
}

Image some_mask(int height, int width) {
  Image mask(height, width, 1);
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x) mask(y, x) = (x + 2 * y) % 3 != 1 && x > 4 ? 1.0f : 0.0f;
  return mask;
}

// Means (or sums) over boxes of two by two pixels, as far as there are pixels.
Image boxes(const Image& image, bool sums) {
  Image result((image.height() + 1) / 2, (image.width() + 1) / 2, image.channels());
  for (int y = 0; y < result.height(); ++y)
    for (int x = 0; x < result.width(); ++x)
      for (int c = 0; c < result.channels(); ++c) {
        double sum = 0;
        int count = 0;
        for (int v = 2 * y; v < std::min(2 * y + 2, image.height()); ++v)
          for (int u = 2 * x; u < std::min(2 * x + 2, image.width()); ++u, ++count) sum += double(image(v, u, c));
        result(y, x, c) = float(sums ? sum : sum / count);
      }
  return result;
}

// The published formula with as many scales as are given, one channel.
double plain_ms_ssim(Image a, Image b, Image weights, int c, int scales) {
  const double published[] = {0.0448, 0.2856, 0.3001, 0.2363, 0.1333};
  double exponents = 0, result = 1;
  for (int j = 0; j < scales; ++j) exponents += published[j];
  for (int j = 0; j < scales; ++j) {
    double sum = 0, total = 0;
    for (int y = 0; y < a.height(); ++y)
      for (int x = 0; x < a.width(); ++x) {
        const auto [ma, mb, va, vb, ab] = test::plain_ssim_window(a, b, y, x, c);
        const double cs = (2 * ab + 9e-4) / (va + vb + 9e-4);
        const double l = j + 1 < scales ? 1 : (2 * ma * mb + 1e-4) / (ma * ma + mb * mb + 1e-4);
        sum += double(weights(y, x)) * l * cs;
        total += double(weights(y, x));
      }
    result *= std::pow(sum / total, published[j] / exponents);
    a = boxes(a, false);
    b = boxes(b, false);
    weights = boxes(weights, true);
  }
  return result;
}

}  // namespace

TEST_CASE("the MS-SSIM of constant pictures, by hand") {
  // Contrast and structure are 1 everywhere; luminance counts at the coarsest scale alone.
  const double luminance = (2 * 0.25 * 0.75 + 1e-4) / (0.25 * 0.25 + 0.75 * 0.75 + 1e-4);
  const auto score = [](int n) { return model::ms_ssim(constant(n, n, 3, 0.25f), constant(n, n, 3, 0.75f), {}); };
  CHECK(score(161) == Approx(std::pow(luminance, 0.1333 / 1.0001)).epsilon(1e-9));
  CHECK(score(160) == Approx(std::pow(luminance, 0.2363 / 0.8668)).epsilon(1e-9));
  CHECK(score(20) == Approx(luminance).epsilon(1e-9));
  CHECK(score(1) == Approx(luminance).epsilon(1e-9));
}

TEST_CASE("MS-SSIM is what its definition says, over a mask, at sizes that do not halve evenly") {
  for (const auto& [size, scales] : {std::pair(core::ImageSize{45, 53, 3}, 3), {{21, 40, 1}, 2}, {{83, 90, 1}, 4}}) {
    const Image a = noise(size, 1), b = resembling(a, 2), mask = some_mask(size.height, size.width);
    double sum = 0;
    for (int c = 0; c < size.channels; ++c) sum += plain_ms_ssim(a, b, mask, c, scales);
    CAPTURE(size.height, size.width);
    CHECK(model::ms_ssim(a, b, mask) == Approx(sum / size.channels).epsilon(1e-6));
  }
}

TEST_CASE("below 21 pixels MS-SSIM is SSIM") {
  for (const core::ImageSize size : {core::ImageSize{1, 1, 3}, {3, 50, 1}, {20, 20, 3}}) {
    const Image a = noise(size, 3), b = resembling(a, 4), mask = some_mask(size.height, size.width);
    const core::ImageView where = size.width > 5 ? core::ImageView(mask) : core::ImageView();
    CHECK(model::ms_ssim(a, b, where) == Approx(1 - 2 * model::dssim(a, b, where)).margin(2e-3));
  }
}

TEST_CASE("MS-SSIM keeps to [0, 1]: a pattern's negative has none, fine noise costs less than coarse") {
  Image pattern(176, 176, 1), fine(176, 176, 1), coarse(176, 176, 1);
  for (int y = 0; y < 176; ++y)
    for (int x = 0; x < 176; ++x) {
      pattern(y, x) = float((x / 2 + y / 2) % 2);
      fine(y, x) = (x + y) % 2 == 0 ? 0.45f : 0.55f;
      coarse(y, x) = (x / 16 + y / 16) % 2 == 0 ? 0.45f : 0.55f;
    }
  Image negative = pattern;
  for (float& v : negative.values()) v = 1 - v;
  CHECK(model::ms_ssim(pattern, negative, {}) == 0);
  const Image grey = constant(176, 176, 1, 0.5f);
  CHECK(model::ms_ssim(grey, fine, {}) > model::ms_ssim(grey, coarse, {}) + 0.2);
}

TEST_CASE("the GMSD of a step against nothing, by hand") {
  // Halved, the columns hold 0 0 1 1; gradients are 0 1 1 0, and similarities with the flat picture 1 q q 1.
  Image step(4, 8, 1);
  for (int y = 0; y < 4; ++y)
    for (int x = 4; x < 8; ++x) step(y, x) = 1;
  const Image flat = constant(4, 8, 1, 0);
  const double c = 170.0 / 65025, q = c / (1 + c);
  CHECK(model::gmsd(step, flat, {}) == Approx((1 - q) / 2));
  // Inside are columns 0 to 4: of the halved ones two wholly and one by half.
  Image mask(4, 8, 1);
  for (int y = 0; y < 4; ++y)
    for (int x = 0; x < 5; ++x) mask(y, x) = 1;
  CHECK(model::gmsd(step, flat, mask) == Approx((1 - q) * std::sqrt(2.0 / 5 * 3.0 / 5)));
  // Grey in three channels is grey.
  CHECK(model::gmsd(core::to_rgb(step), core::to_rgb(flat), {}) == Approx((1 - q) / 2).epsilon(1e-5));
  // What is wrong alike everywhere is not seen.
  CHECK(model::gmsd(constant(9, 7, 3, 0.1f), constant(9, 7, 3, 0.8f), {}) == 0);
  CHECK(model::gmsd(constant(1, 1, 1, 0), constant(1, 1, 1, 1), {}) == 0);
}

TEST_CASE("GMSD agrees with OpenCV's away from the border") {
  const core::ImageSize size{64, 80, 1};
  const Image a = noise(size, 1), b = resembling(a, 2);
  const auto code_values = [](const Image& image) {
    cv::Mat mat(image.height(), image.width(), CV_32F);
    for (int y = 0; y < mat.rows; ++y)
      for (int x = 0; x < mat.cols; ++x) mat.at<float>(y, x) = 255 * image(y, x);
    return mat;
  };
  cv::Mat similarity;
  cv::quality::QualityGMSD::compute(code_values(a), code_values(b), similarity);
  similarity.convertTo(similarity, CV_32F);
  REQUIRE(similarity.size() == cv::Size(40, 32));
  Image inside(size.height, size.width, 1);
  for (int y = 8; y < 56; ++y)
    for (int x = 8; x < 72; ++x) inside(y, x) = 1;
  cv::Scalar mean, deviation;
  cv::meanStdDev(similarity(cv::Rect(4, 4, 32, 24)), mean, deviation);
  CHECK(deviation[0] > 0.05);
  CHECK(model::gmsd(a, b, inside) == Approx(deviation[0]).epsilon(1e-4));
}

TEST_CASE("MS-SSIM and GMSD are best for equal pictures, symmetric, blind to mirroring and to the thread count") {
  for (const core::ImageSize size : {core::ImageSize{2, 4, 3}, {48, 64, 3}, {176, 192, 1}}) {
    const Image a = noise(size, 5), b = resembling(a, 6);
    const Image mask = some_mask(size.height, size.width);
    const core::ImageView where = size.width > 5 ? core::ImageView(mask) : core::ImageView();
    const Image mirrored_mask = mirrored(mask);
    const core::ImageView mirrored_where = size.width > 5 ? core::ImageView(mirrored_mask) : core::ImageView();
    CHECK(model::ms_ssim(a, a, where) == Approx(1).epsilon(1e-12));
    CHECK(model::gmsd(a, a, where) == Approx(0).margin(1e-7));
    for (const auto metric : {model::ms_ssim, model::gmsd}) {
      const double value = metric(a, b, where);
      CHECK(value >= 0);
      CHECK(value < 1);
      CHECK(metric(b, a, where) == Approx(value).epsilon(1e-12));
      CHECK(metric(mirrored(a), mirrored(b), mirrored_where) == Approx(value).epsilon(1e-9));
      for (const int threads : {1, 3}) {
        core::set_thread_count(threads);
        CHECK(metric(a, b, where) == value);
      }
      core::set_thread_count(0);
    }
  }
}

TEST_CASE("MS-SSIM and GMSD refuse pictures and masks that do not fit") {
  const Image a(4, 5, 3);
  for (const auto metric : {model::ms_ssim, model::gmsd, model::hdr_flip}) {
    CHECK_THROWS_AS(metric(a, Image(5, 4, 3), {}), core::BadInput);
    CHECK_THROWS_AS(metric(a, a, Image(4, 4, 1)), core::BadInput);
    CHECK_THROWS_AS(metric(a, a, Image(4, 5, 1)), core::BadInput);  // nothing inside
    CHECK_THROWS_AS(metric(Image(), Image(), {}), core::BadInput);
  }
}

}  // namespace lightstage
