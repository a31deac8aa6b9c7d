// The parts of the engine that need no network: runs of every length, and statistics of maps that are nearly constant.
#include <catch2/catch.hpp>

#include <cstring>
#include <random>

#include "model/engine/convolution.h"
#include "model/engine/normalisation.h"

namespace lightstage {
namespace {

using model::kLanes;

std::vector<float> random_values(std::size_t count, unsigned seed) {
  std::mt19937 generator(seed);
  std::vector<float> values(count);
  for (float& v : values) v = float(generator()) / float(std::mt19937::max()) - 0.5f;
  return values;
}

// Sums in the order in which they are defined, in float64.
double doubled(const std::vector<float>& image, const std::vector<float>& weight, int in, int out, int height,
               int width, int o, int y, int x) {
  double sum = 0;
  for (int i = 0; i < in; ++i) {
    for (int ky = 0; ky < 3; ++ky) {
      for (int kx = 0; kx < 3; ++kx) {
        const int from_y = y + 1 - ky, from_x = x + 1 - kx;  // twice the input's place
        if (from_y % 2 != 0 || from_x % 2 != 0 || from_y < 0 || from_x < 0) continue;
        if (from_y / 2 >= height || from_x / 2 >= width) continue;
        sum += double(image[std::size_t((i * height + from_y / 2) * width + from_x / 2)]) *
               double(weight[std::size_t(((i * out + o) * 3 + ky) * 3 + kx)]);
      }
    }
  }
  return sum;
}

TEST_CASE("runs of every length and instruction set are the transposed convolution") {
  const int width = GENERATE(range(1, 32));
  const int in = 20, out = 24, height = 2;
  const std::vector<float> image = random_values(std::size_t(in * height * width), 1);
  const std::vector<float> weight = random_values(std::size_t(in * out * 9), 2), bias = random_values(out, 3);
  for (const model::Kernels* kernels : model::all_float_kernels()) {
    CAPTURE(kernels->name, width);
    const int parts[] = {in};
    const auto packed = model::PackedConvolution::doubling(weight, bias, parts, kernels->number);
    model::FeatureMap input(height, width, in, kernels->number, {.right = 1, .bottom = 1});
    for (int i = 0; i < in; ++i) {
      for (int y = 0; y < height; ++y) {
        for (int x = 0; x < width; ++x) {
          const model::Row row = input.row(y);
          std::byte* const place = row.data + std::size_t(i / kLanes) * row.block_bytes +
                                   std::size_t(x * kLanes + i % kLanes) * sizeof(float);
          std::memcpy(place, &image[std::size_t((i * height + y) * width + x)], sizeof(float));
        }
      }
    }
    const model::FeatureMap output(2 * height, 2 * width, out, model::Number::kFloat32);
    model::Moments moments;
    for (const auto& phase : packed.phases()) {
      for (int y = 0; y < height; ++y) {
        const model::ConstRow rows[] = {input.row(y), input.row(y + 1)};
        // Both ways of writing.
        packed.run_row(*kernels, 0, phase, rows, width, output.row(2 * y + phase.y), /*past_caches=*/y == 1, moments);
      }
    }
    CHECK(moments.count == 4 * height * width);
    double largest = 0, sum = 0, expected_sum = 0;
    for (int y = 0; y < 2 * height; ++y) {
      for (int x = 0; x < 2 * width; ++x) {
        for (const int o : {0, 7, 15, 16, 23}) {
          const model::Row row = output.row(y);
          float value;
          std::memcpy(&value,
                      row.data + std::size_t(o / kLanes) * row.block_bytes +
                          std::size_t(x * kLanes + o % kLanes) * sizeof(float),
                      sizeof value);
          const double expected =
              double(bias[std::size_t(o)]) + doubled(image, weight, in, out, height, width, o, y, x);
          largest = std::max(largest, std::abs(double(value) - expected));
          if (o == 7) expected_sum += expected;
        }
      }
    }
    sum = moments.sum[7] + moments.count * double(moments.pivot[7]);
    CHECK(largest < 1e-5);
    CHECK(sum == Approx(expected_sum).margin(1e-4));
  }
}

// The nearest half-precision number, of two equally near ones the even one, by its definition.
float nearest_half(float value) {
  const double x = std::min(65504.0, std::abs(double(value)));
  const int exponent = x == 0 ? -14 : std::max(-14, std::ilogb(x));
  const double unit = std::ldexp(1.0, exponent - 10);
  return float(std::copysign(std::min(65504.0, std::nearbyint(x / unit) * unit), double(value)));
}

TEST_CASE("every instruction set stores the nearest half-precision number") {
  std::vector<float> values{0.f, -0.f, 1.f, 65504.f, 65519.f, 65520.f, 1e6f, -1e6f, 1e38f, INFINITY, -INFINITY, 1e-40f};
  for (int exponent = -27; exponent <= 16; ++exponent) {
    for (const float mantissa :
         {1.f, 1.f + 0x1p-11f, 1.f + 0x1p-10f, 1.f + 0x3p-11f, 1.f + 0x1p-11f + 0x1p-20f, 1.999f})
      values.push_back((exponent % 2 == 0 ? 1.f : -1.f) * std::ldexp(mantissa, exponent));
  }
  for (const float v : random_values(4096, 9)) values.push_back(8 * v);
  values.resize((values.size() + kLanes - 1) / kLanes * kLanes, 0.f);
  for (const model::Kernels* kernels : model::all_float_kernels()) {
    CAPTURE(kernels->name);
    std::vector<model::Float16> halves(values.size());
    kernels->shorten(values.data(), halves.data(), values.size() / kLanes);
    std::vector<float> back(values.size());
    const void* const in[] = {halves.data()};
    const float one = 1;
    kernels->pool_float16(in, &one, 1, back.data(), values.size() / kLanes);
    for (std::size_t i = 0; i < values.size(); ++i) {
      CAPTURE(values[i]);
      REQUIRE(back[i] == nearest_half(values[i]));
    }

    std::vector<float> nans(kLanes, NAN);
    kernels->shorten(nans.data(), halves.data(), 1);
    kernels->pool_float16(in, &one, 1, back.data(), 1);
    for (int lane = 0; lane < kLanes; ++lane) CHECK(std::isnan(back[std::size_t(lane)]));
  }
}

TEST_CASE("group norm keeps the variance of maps far from zero") {
  // All channels at `mean`, half of the pixels `step` above it: variance step^2 / 4.
  const double mean = GENERATE(0.0, 1.0, 1e3), step = GENERATE(0.0, 0.25);
  std::vector<model::Moments> parts(3);
  for (model::Moments& part : parts) {
    part.count = 100;
    for (int lane = 0; lane < 2 * kLanes; ++lane) {
      part.pivot[lane] = float(mean);
      part.sum[lane] = 50 * step;
      part.squares[lane] = 50 * step * step;
    }
  }
  const std::vector<float> ones(8, 1.f), zeros(8, 0.f);
  const auto affine = model::group_norm(parts, 3, {ones, zeros, zeros});
  REQUIRE(affine.size() == 1);
  const double deviation = std::sqrt(step * step / 4 + 1e-5);
  CHECK(affine[0].gain[0] == Approx(1 / deviation));
  CHECK(affine[0].offset[7] == Approx(-(mean + step / 2) / deviation).margin(1e-9));
  CHECK(affine[0].gain[8] == 0);  // no such channel
}

}  // namespace
}  // namespace lightstage
