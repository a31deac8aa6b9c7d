// The loops behind model/engine/kernels.h, written once with vectors of 16 lanes that the compiler maps to what the instruction set has.
// Included by one source file for each instruction set, so everything here is local to that file, and nothing from the standard
// library is called: an inline function compiled for AVX-512 must not be the one that the linker keeps for everybody.
#pragma once

#include <cstddef>
#include <cstdint>

#include "model/engine/kernels.h"
#include "model/engine/lanes.h"

namespace lightstage::model {
namespace {

// Registers for accumulators decide how long runs are.
#if defined(__AVX512F__)
constexpr int kRun = 14;
constexpr int kPicturePixels = 8;
#elif defined(__AVX2__)
constexpr int kRun = 3;
constexpr int kPicturePixels = 2;
#else
constexpr int kRun = 2;
constexpr int kPicturePixels = 1;
#endif

struct Float32 {
  using Stored = float;
  using Word = float;
  static constexpr Number kNumber = Number::kFloat32;
  static constexpr int kWords = kLanes;
  static void multiply_add(Vector& sum, float word, const Vector& weights) { sum += weights * word; }
};

#if defined(__AVX512BF16__)
struct Bfloat16Pair {
  using Stored = Bfloat16;
  using Word = std::int32_t;
  static constexpr Number kNumber = Number::kBfloat16;
  static constexpr int kWords = kLanes / 2;
  static void multiply_add(Vector& sum, std::int32_t word, const Vector& weights) {
    sum.part[0] = _mm512_dpbf16_ps(sum.part[0], __m512bh(_mm512_set1_epi32(word)), __m512bh(weights.part[0]));
  }
};
#endif

inline void add_moments(Moments& moments, int block, const Vector* values, int count) {
  float* const pivot = moments.pivot + block * kLanes;
  if (moments.count == 0) store(values[0], pivot);
  const Vector origin = load(pivot);
  Vector sum{}, squares{};
#pragma GCC unroll 14
  for (int p = 0; p < count; ++p) {
    const Vector difference = values[p] - origin;
    sum += difference;
    squares += difference * difference;
  }
  add_to(sum, moments.sum + block * kLanes);
  add_to(squares, moments.squares + block * kLanes);
}

template <class N, int kStride, int kBlocks, int kPixels>
void convolve(const ConvolutionRun& run) {
  using Word = typename N::Word;
  Vector sums[kBlocks][kPixels];
#pragma GCC unroll 2
  for (int o = 0; o < kBlocks; ++o) {
#pragma GCC unroll 14
    for (int p = 0; p < kPixels; ++p) sums[o][p] = load(run.bias + o * kLanes);
  }
  const float* weights = static_cast<const float*>(run.weights);
  for (int b = 0; b < run.input_blocks; ++b) {
    for (int t = 0; t < run.tap_count; ++t) {
      const char* const start = static_cast<const char*>(run.taps[t]) + std::size_t(b) * run.input_block_bytes;
      const Word* in = reinterpret_cast<const Word*>(start);
      for (int c = 0; c < run.words; ++c, ++in, weights += kBlocks * kLanes) {
        Vector w[kBlocks];
#pragma GCC unroll 2
        for (int o = 0; o < kBlocks; ++o) w[o] = load(weights + o * kLanes);
#pragma GCC unroll 14
        for (int p = 0; p < kPixels; ++p) {
          const Word word = in[p * kStride * N::kWords];
#pragma GCC unroll 2
          for (int o = 0; o < kBlocks; ++o) N::multiply_add(sums[o][p], word, w[o]);
        }
      }
    }
  }
#pragma GCC unroll 2
  for (int o = 0; o < kBlocks; ++o) {
    char* out = reinterpret_cast<char*>(run.output) + std::size_t(o) * run.output_block_bytes;
    const auto pixel = [&](int p) { return reinterpret_cast<float*>(out + std::size_t(p) * run.output_pixel_bytes); };
    if (run.past_caches) {
#pragma GCC unroll 14
      for (int p = 0; p < kPixels; ++p) stream(sums[o][p], pixel(p));
    } else {
#pragma GCC unroll 14
      for (int p = 0; p < kPixels; ++p) store(sums[o][p], pixel(p));
    }
    add_moments(*run.moments, o, sums[o], kPixels);
  }
  run.moments->count += kPixels;
}

template <class Out>
void normalise(const float* in, Out* out, std::size_t pixels, const BlockAffine& affine) {
  const Vector gain = load(affine.gain), offset = load(affine.offset), slope = load(affine.slope);
  for (std::size_t p = 0; p < pixels; ++p, in += kLanes, out += kLanes) {
    const Vector z = load(in) * gain + offset;
    store(prelu(z, slope), out);
  }
}

template <class In, class Out>
void pool(const void* const* in, const float* weights, int count, void* out, std::size_t blocks) {
  Out* const result = static_cast<Out*>(out);
  for (std::size_t i = 0; i < blocks * kLanes; i += kLanes) {
    Vector sum = load(static_cast<const In*>(in[0]) + i) * weights[0];
    for (int n = 1; n < count; ++n) sum += load(static_cast<const In*>(in[n]) + i) * weights[n];
    store(sum, result + i);
  }
}

inline void picture(const PictureRow& row) {
  for (int x = 0; x < row.width; x += kPicturePixels) {
    Vector sums[3][kPicturePixels] = {};
    const float* weights = row.weights;
    for (int ky = 0; ky < 3; ++ky) {
      for (int b = 0; b < row.blocks; ++b) {
        const float* const in = row.rows[ky] + std::size_t(b) * row.block_floats + x * kLanes;
#pragma GCC unroll 3
        for (int kx = 0; kx < 3; ++kx, weights += 3 * kLanes) {
          const Vector w0 = load(weights), w1 = load(weights + kLanes), w2 = load(weights + 2 * kLanes);
#pragma GCC unroll 8
          for (int p = 0; p < kPicturePixels; ++p) {
            const Vector value = load(in + (p + kx) * kLanes);
            sums[0][p] += value * w0;
            sums[1][p] += value * w1;
            sums[2][p] += value * w2;
          }
        }
      }
    }
    float* const out = row.rgb + std::size_t(x) * 3;
    const int count = row.width - x < kPicturePixels ? row.width - x : kPicturePixels;
#pragma GCC unroll 3
    for (int o = 0; o < 3; ++o) {
      int lanes = kLanes;
#pragma GCC unroll 4
      for (int n = kPicturePixels; n > 1; n /= 2, lanes /= 2) {
#pragma GCC unroll 4
        for (int p = 0; p < n / 2; ++p) sums[o][p] = fold(sums[o][2 * p], sums[o][2 * p + 1]);
      }
#pragma GCC unroll 4
      for (; lanes > 1; lanes /= 2) sums[o][0] = fold(sums[o][0], sums[o][0]);
      alignas(64) float values[kLanes];
      store(sigmoid(sums[o][0] + broadcast(row.bias[o])), values);
      for (int p = 0; p < count; ++p) out[p * 3 + o] = values[p];
    }
  }
}

template <class N, int kStride, int kBlocks, int kPixels>
constexpr void fill_runs(Kernels& kernels) {
  kernels.convolve[kStride - 1][kBlocks - 1][kPixels - 1] = convolve<N, kStride, kBlocks, kPixels>;
  if constexpr (kPixels > 1) fill_runs<N, kStride, kBlocks, kPixels - 1>(kernels);
}

template <class N>
constexpr Kernels make_kernels(const char* name) {
  using Stored = typename N::Stored;
  Kernels kernels{};
  kernels.name = name;
  kernels.number = N::kNumber;
  kernels.widest_run = kRun;
  fill_runs<N, 1, 1, kRun>(kernels);
  fill_runs<N, 1, 2, kRun>(kernels);
  fill_runs<N, 2, 1, kRun>(kernels);
  fill_runs<N, 2, 2, kRun>(kernels);
  kernels.normalise = [](const float* in, void* out, std::size_t pixels, const BlockAffine& affine) {
    normalise(in, static_cast<Stored*>(out), pixels, affine);
  };
  kernels.normalise_to_float = normalise<float>;
  kernels.pool_float = pool<float, Stored>;
  kernels.pool_float16 = pool<Float16, Stored>;
  kernels.picture = picture;
  kernels.shorten = [](const float* in, Float16* out, std::size_t blocks) {
    for (std::size_t i = 0; i < blocks * kLanes; i += kLanes) store(load(in + i), out + i);
  };
  return kernels;
}

}  // namespace
}  // namespace lightstage::model
