#include "core/image.h"

#include <algorithm>
#include <catch2/catch.hpp>
#include <cmath>
#include <limits>
#include <numeric>
#include <optional>
#include <random>

#include "core/display.h"
#include "core/error.h"
#include "core/failure.h"
#include "core/parallel.h"

using namespace lightstage;
using core::Image;
using core::ImageSize;
using core::ImageView;

namespace {

Image noise(int height, int width, int channels, unsigned seed) {
  Image image(height, width, channels);
  std::mt19937 generator(seed);
  for (float& v : image.values()) v = float(generator() >> 8) * 0x1p-24f - 0.25f;
  return image;
}

// The same sum, one value at a time, in extended precision.
Image slow_weighted_sum(const std::vector<ImageView>& images, const std::vector<double>& weights) {
  Image result(images[0].size());
  for (int y = 0; y < result.height(); ++y)
    for (int x = 0; x < result.width(); ++x)
      for (int c = 0; c < result.channels(); ++c) {
        long double sum = 0;
        for (std::size_t i = 0; i < images.size(); ++i)
          if (weights[i] != 0) sum += static_cast<long double>(weights[i]) * images[i](y, x, c);
        result(y, x, c) = static_cast<float>(sum);
      }
  return result;
}

const std::vector<ImageSize> kOddSizes{{1, 1, 1},     {3, 4099, 3},  {4099, 3, 3},
                                       {127, 131, 3}, {1, 16384, 4}, {31, 37, 1}};

}  // namespace

TEST_CASE("an image starts black and keeps its values in rows of pixels of channels") {
  Image image(2, 3, 2);
  CHECK(std::all_of(image.values().begin(), image.values().end(), [](float v) { return v == 0; }));
  image(1, 2, 1) = 5;
  CHECK(image.values()[(1 * 3 + 2) * 2 + 1] == 5);
  CHECK(image.view()(1, 2, 1) == 5);
  CHECK(Image(0, 5, 3).empty());
  CHECK(Image().empty());
}

TEST_CASE("impossible sizes are refused before memory is asked for") {
  CHECK_THROWS_AS(Image(-1, 2, 3), core::BadInput);
  CHECK_THROWS_AS(Image(2, 2, -3), core::BadInput);
  constexpr int huge = std::numeric_limits<int>::max();
  CHECK_THROWS_AS(Image(huge, huge, huge), core::BadInput);
  CHECK_THROWS_AS(Image(1 << 20, 1 << 20, 2), core::BadInput);
}

TEST_CASE("a crop shows the pixels of its owner, and copies as they are seen") {
  Image image = noise(7, 11, 3, 1);
  const ImageView crop = image.view().crop(2, 3, 4, 5);
  CHECK(crop.size() == ImageSize{4, 5, 3});
  CHECK_FALSE(crop.contiguous());
  CHECK(crop(1, 2, 1) == image(3, 5, 1));
  const Image copy(crop);
  CHECK(copy.size() == crop.size());
  for (int y = 0; y < 4; ++y)
    for (int x = 0; x < 5; ++x)
      for (int c = 0; c < 3; ++c) CHECK(copy(y, x, c) == image(y + 2, x + 3, c));
  image.mutable_view().crop(2, 3, 4, 5)(0, 0, 0) = 9;
  CHECK(image(2, 3, 0) == 9);
  CHECK(copy(0, 0, 0) != 9);
}

TEST_CASE("grey becomes RGB by repetition, and alpha is dropped") {
  for (const int channels : {1, 2, 3, 4}) {
    const Image image = noise(5, 3, channels, 2);
    const Image rgb = core::to_rgb(image);
    REQUIRE(rgb.size() == ImageSize{5, 3, 3});
    for (int c = 0; c < 3; ++c) CHECK(rgb(4, 2, c) == image(4, 2, channels <= 2 ? 0 : c));
  }
  CHECK_THROWS_AS(core::to_rgb(Image(2, 2, 5)), core::BadInput);
}

TEST_CASE("luminance weighs by Rec. 709 and keeps white at its value") {
  Image image(1, 4, 4);
  for (int c = 0; c < 3; ++c) image(0, c, c) = 1;
  for (int c = 0; c < 4; ++c) image(0, 3, c) = 1e5f;
  const Image y = core::to_luminance(image);
  REQUIRE(y.size() == ImageSize{1, 4, 1});
  CHECK(y(0, 0) == Approx(0.2126));
  CHECK(y(0, 1) == Approx(0.7152));
  CHECK(y(0, 2) == Approx(0.0722));
  CHECK(y(0, 3) == 1e5f);
  const Image grey = noise(2, 2, 1, 3);
  CHECK(core::to_luminance(grey) == grey);
  CHECK_THROWS_AS(core::to_luminance(Image(2, 2, 0)), core::BadInput);
}

TEST_CASE("shrinking averages whole boxes, and what is left at the edges by itself") {
  Image image(3, 5, 2);
  std::iota(image.values().begin(), image.values().end(), 0.0f);
  const Image half = core::shrink_by_box(image, 2);
  REQUIRE(half.size() == ImageSize{2, 3, 2});
  CHECK(half(0, 0, 0) == (0 + 2 + 10 + 12) / 4.0f);
  CHECK(half(0, 2, 1) == (9 + 19) / 2.0f);
  CHECK(half(1, 0, 0) == (20 + 22) / 2.0f);
  CHECK(half(1, 2, 1) == 29);
  CHECK(core::shrink_by_box(image, 1) == image);
  const Image all = core::shrink_by_box(image, std::numeric_limits<int>::max());
  REQUIRE(all.size() == ImageSize{1, 1, 2});
  CHECK(all(0, 0, 0) == 14);
  CHECK(core::shrink_by_box(Image(0, 4, 3), 2).empty());
  CHECK_THROWS_AS(core::shrink_by_box(image, 0), core::BadInput);
  // float32 sums would stop growing at 2^24.
  Image flat(5000, 4001, 1);
  std::fill(flat.values().begin(), flat.values().end(), 0.1f);
  CHECK(core::shrink_by_box(flat, 5000)(0, 0) == 0.1f);
}

TEST_CASE("a weighted sum agrees with the slow one over odd sizes, at every thread count") {
  for (const ImageSize size : kOddSizes) {
    std::vector<Image> images;
    for (unsigned i = 0; i < 7; ++i) images.push_back(noise(size.height, size.width, size.channels, i));
    const std::vector<ImageView> views(images.begin(), images.end());
    const std::vector<double> weights{0.3, -1.7, 0, 1e-3, 2.5, -0.9, 0.01};
    const Image expected = slow_weighted_sum(views, weights);
    std::optional<Image> first;
    for (const int threads : {1, 2, 7}) {
      core::set_thread_count(threads);
      const Image sum = core::weighted_sum(views, weights);
      for (std::size_t i = 0; i < sum.values().size(); ++i)
        REQUIRE(sum.values()[i] == Approx(expected.values()[i]).margin(1e-7));
      if (!first) first = sum;
      CHECK(sum == *first);  // to the last bit
    }
  }
  core::set_thread_count(0);
}

TEST_CASE("a weighted sum of crops reads only the crops") {
  const Image a = noise(41, 53, 3, 1), b = noise(19, 47, 3, 2);
  const std::vector<ImageView> crops{a.view().crop(3, 5, 17, 23), b.view().crop(1, 7, 17, 23)};
  const std::vector<double> weights{0.5, 0.25};
  const Image sum = core::weighted_sum(crops, weights);
  CHECK(sum == slow_weighted_sum(crops, weights));
}

TEST_CASE("a long weighted sum of cancelling lights keeps float32's digits") {
  // 4,000 pairs that cancel, beside one small value: products or sums in float32 would leave rounding errors only.
  const auto flat = [](float value) {
    Image image(3, 3, 1);
    std::fill(image.values().begin(), image.values().end(), value);
    return image;
  };
  constexpr float kBright = 98765.43f, kDim = 54321.98f;
  const Image bright = flat(kBright), dim = flat(kDim), small = flat(1e-3f);
  std::vector<ImageView> views;
  std::vector<double> weights;
  for (int i = 0; i < 4000; ++i) {
    const double weight = 0.7123 + 1e-4 * i;
    views.push_back(bright);
    weights.push_back(weight);
    views.push_back(dim);
    weights.push_back(-weight * double(kBright) / double(kDim));
  }
  views.push_back(small);
  weights.push_back(1);
  CHECK(core::weighted_sum(views, weights)(1, 1) == Approx(1e-3).epsilon(1e-5));
}

TEST_CASE("images of weight zero are not read, and bad sums are refused") {
  Image poisoned(2, 2, 1);
  std::fill(poisoned.values().begin(), poisoned.values().end(), std::numeric_limits<float>::quiet_NaN());
  const Image one = noise(2, 2, 1, 1);
  CHECK(core::weighted_sum(std::vector<ImageView>{poisoned, one}, std::vector<double>{0, 1}) == one);
  CHECK(core::weighted_sum(std::vector<ImageView>{one}, std::vector<double>{0}) == Image(2, 2, 1));
  const Image other(2, 3, 1);
  const std::string message = test::failure_of<core::BadInput>([&] {
    core::weighted_sum(std::vector<ImageView>{one, other}, std::vector<double>{1, 0});
  });
  CHECK(test::says(message, "image 1", "3x2"));
  CHECK_THROWS_AS(core::weighted_sum({}, {}), core::BadInput);
  CHECK_THROWS_AS(core::weighted_sum(std::vector<ImageView>{one}, std::vector<double>{1, 2}), core::BadInput);
  CHECK_THROWS_AS(core::weighted_sum(std::vector<ImageView>{one}, std::vector<double>{std::nan("")}), core::BadInput);
}

TEST_CASE("quantiles are linear between order statistics") {
  const std::vector<float> values{5, 1, 4, 2, 3};
  CHECK(core::quantile(values, 0) == 1);
  CHECK(core::quantile(values, 1) == 5);
  CHECK(core::quantile(values, 0.5) == 3);
  CHECK(core::quantile(values, 0.375) == Approx(2.5));
  CHECK(core::quantile(std::vector<float>{7}, 0.3) == 7);
  constexpr float largest = std::numeric_limits<float>::max();
  CHECK(core::quantile(std::vector<float>{largest, -largest}, 0.5) == 0);
  const Image image = noise(97, 89, 1, 9);
  std::vector<float> sorted(image.values().begin(), image.values().end());
  std::sort(sorted.begin(), sorted.end());
  for (const double q : {0.001, 0.25, 0.77, 0.995}) {
    const double position = q * double(sorted.size() - 1);
    const std::size_t i = std::size_t(position);
    CHECK(core::quantile(image.values(), q) ==
          Approx(sorted[i] + (position - double(i)) * (double(sorted[i + 1]) - sorted[i])).epsilon(1e-12));
  }
  CHECK_THROWS_AS(core::quantile({}, 0.5), core::BadInput);
  for (const double q : {-0.1, 1.1, std::nan("")}) CHECK_THROWS_AS(core::quantile(values, q), core::BadInput);
}

TEST_CASE("sRGB follows its standard and undoes itself") {
  CHECK(core::srgb_encode(0.0f) == 0);
  CHECK(core::srgb_encode(1.0f) == Approx(1).margin(1e-6));
  CHECK(core::srgb_encode(0.18f) == Approx(0.46135612950));
  CHECK(core::srgb_decode(0.5f) == Approx(0.21404114048));
  CHECK(core::srgb_encode(-0.001f) == Approx(-0.01292));
  CHECK(core::srgb_encode(4.0f) > 1);
  // Every 16-bit code finds back to itself.
  for (int code = 0; code <= 65535; ++code) {
    const float back = core::srgb_encode(core::srgb_decode(float(code) / 65535.0f));
    REQUIRE(std::lround(back * 65535.0f) == code);
  }
}

TEST_CASE("display encoding is the power 1/2.2, finite for everything finite") {
  CHECK(core::display_encode(0.5f) == Approx(std::pow(0.5, 1 / 2.2)).epsilon(1e-6));
  CHECK(core::display_decode(0.5f) == Approx(std::pow(0.5, 2.2)).epsilon(1e-6));
  constexpr float largest = std::numeric_limits<float>::max(), smallest = std::numeric_limits<float>::denorm_min();
  for (const float v : {0.0f, -0.0f, -1.0f, -largest, smallest, 1e5f, largest}) {
    CHECK(std::isfinite(core::display_encode(v)));
    CHECK(std::isfinite(core::display_decode(v)));
  }
  CHECK(core::display_encode(-3.0f) == 0);
  CHECK(core::display_encode(smallest) > 0);
  CHECK(core::display_decode(largest) == largest);
  // What went wrong before stays visible.
  CHECK(std::isnan(core::display_encode(std::numeric_limits<float>::quiet_NaN())));
  CHECK(std::isnan(core::display_decode(std::numeric_limits<float>::quiet_NaN())));
}

TEST_CASE("images are display-encoded value by value, crops too, at every thread count") {
  for (const ImageSize size : kOddSizes) {
    const Image image = noise(size.height, size.width, size.channels, 5);
    for (const int threads : {1, 3}) {
      core::set_thread_count(threads);
      const Image encoded = core::display_encode(image);
      const Image decoded = core::display_decode(image);
      REQUIRE(encoded.size() == size);
      for (std::size_t i = 0; i < image.values().size(); ++i) {
        REQUIRE(encoded.values()[i] == core::display_encode(image.values()[i]));
        REQUIRE(decoded.values()[i] == core::display_decode(image.values()[i]));
      }
    }
  }
  core::set_thread_count(0);
  const Image image = noise(9, 9, 3, 6);
  const Image crop = core::display_encode(image.view().crop(1, 2, 3, 4));
  CHECK(crop(2, 3, 1) == core::display_encode(image(3, 5, 1)));
  CHECK(core::display_encode(Image(0, 3, 3)).empty());
}

TEST_CASE("a stop doubles the light") {
  const Image image = noise(3, 5, 3, 7);
  const Image brighter = core::expose(image, 3), darker = core::expose(image, -1), same = core::expose(image, 0);
  for (std::size_t i = 0; i < image.values().size(); ++i) {
    REQUIRE(brighter.values()[i] == 8 * image.values()[i]);
    REQUIRE(darker.values()[i] == image.values()[i] / 2);
  }
  CHECK(same == image);
}
