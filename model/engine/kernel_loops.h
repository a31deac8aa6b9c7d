// The loops behind model/engine/kernels.h, written once with vectors of 16 lanes that the compiler maps to what the instruction set has.
// Included by one source file for each instruction set, so everything here is local to that file, and nothing from the standard
// library is called: an inline function compiled for AVX-512 must not be the one that the linker keeps for everybody.
#pragma once

#include <cstddef>
#include <cstdint>
#include <cstring>

#if defined(__AVX512BF16__)
#include <immintrin.h>
#endif

#include "model/engine/kernels.h"

namespace lightstage::model {
namespace {

typedef float Vector __attribute__((vector_size(64)));
typedef double DoubleVector __attribute__((vector_size(128)));
typedef std::int32_t IntVector __attribute__((vector_size(64)));
typedef std::uint32_t UintVector __attribute__((vector_size(64)));
typedef std::uint16_t ShortVector __attribute__((vector_size(32)));

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

inline Vector load(const float* p) {
  Vector v;
  std::memcpy(&v, p, sizeof v);
  return v;
}

inline void store(Vector v, float* p) {
  std::memcpy(p, &v, sizeof v);
}

inline Vector load(const Bfloat16* p) {
  ShortVector halves;
  std::memcpy(&halves, p, sizeof halves);
  return Vector(__builtin_convertvector(halves, UintVector) << 16);
}

// Rounded to the nearest, ties to even.
inline void store(Vector v, Bfloat16* p) {
#if defined(__AVX512BF16__)
  const __m256bh halves = _mm512_cvtneps_pbh(__m512(v));
#else
  const UintVector bits = UintVector(v);
  const ShortVector halves = __builtin_convertvector((bits + 0x7fff + ((bits >> 16) & 1)) >> 16, ShortVector);
#endif
  std::memcpy(p, &halves, sizeof halves);
}

struct Float32 {
  using Stored = float;
  using Word = float;
  static constexpr Number kNumber = Number::kFloat32;
  static constexpr int kWords = kLanes;
  static Vector multiply_add(Vector sum, float word, const Vector& weights) { return sum + word * weights; }
};

#if defined(__AVX512BF16__)
struct Bfloat16Pair {
  using Stored = Bfloat16;
  using Word = std::int32_t;
  static constexpr Number kNumber = Number::kBfloat16;
  static constexpr int kWords = kLanes / 2;
  static Vector multiply_add(Vector sum, std::int32_t word, const Vector& weights) {
    return Vector(_mm512_dpbf16_ps(__m512(sum), __m512bh(_mm512_set1_epi32(word)), __m512bh(__m512(weights))));
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
  const auto add = [](Vector v, double* total) {
    DoubleVector t;
    std::memcpy(&t, total, sizeof t);
    t += __builtin_convertvector(v, DoubleVector);
    std::memcpy(total, &t, sizeof t);
  };
  add(sum, moments.sum + block * kLanes);
  add(squares, moments.squares + block * kLanes);
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
          for (int o = 0; o < kBlocks; ++o) sums[o][p] = N::multiply_add(sums[o][p], word, w[o]);
        }
      }
    }
  }
#pragma GCC unroll 2
  for (int o = 0; o < kBlocks; ++o) {
    char* out = static_cast<char*>(run.output) + std::size_t(o) * run.output_block_bytes;
#pragma GCC unroll 14
    for (int p = 0; p < kPixels; ++p) {
      store(sums[o][p], reinterpret_cast<typename N::Stored*>(out + std::size_t(p) * run.output_pixel_bytes));
    }
    add_moments(*run.moments, o, sums[o], kPixels);
  }
  run.moments->count += kPixels;
}

template <class In, class Out>
void normalise(const In* in, Out* out, std::size_t pixels, const BlockAffine& affine) {
  const Vector gain = load(affine.gain), offset = load(affine.offset), slope = load(affine.slope);
  for (std::size_t p = 0; p < pixels; ++p, in += kLanes, out += kLanes) {
    const Vector z = load(in) * gain + offset;
    store(z > 0 ? z : z * slope, out);
  }
}

template <class In, class Out>
void pool(const void* const* in, const float* weights, int count, void* out, std::size_t blocks) {
  Out* const result = static_cast<Out*>(out);
  for (std::size_t i = 0; i < blocks * kLanes; i += kLanes) {
    Vector sum = weights[0] * load(static_cast<const In*>(in[0]) + i);
    for (int n = 1; n < count; ++n) sum += weights[n] * load(static_cast<const In*>(in[n]) + i);
    store(sum, result + i);
  }
}

// Sums of neighbours: those of a in the lower half, those of b in the upper.
inline Vector fold(Vector a, Vector b) {
  return __builtin_shufflevector(a, b, 0, 2, 4, 6, 8, 10, 12, 14, 16, 18, 20, 22, 24, 26, 28, 30) +
         __builtin_shufflevector(a, b, 1, 3, 5, 7, 9, 11, 13, 15, 17, 19, 21, 23, 25, 27, 29, 31);
}

// exp(x) by exp(n ln 2) exp(r), |r| <= ln(2)/2: relative error below 2e-7. x within +-87.
inline Vector exponential(Vector x) {
  constexpr float kMagic = 12582912;  // 1.5 * 2^23: adding it leaves a number rounded to an integer in the lowest bits
  const Vector shifted = x * 1.44269504f + kMagic;
  const Vector n = shifted - kMagic;
  const Vector r = (x - n * 0.693359375f) + n * 2.12194440e-4f;
  Vector y = r * (1.f / 5040) + 1.f / 720;
  y = y * r + 1.f / 120;
  y = y * r + 1.f / 24;
  y = y * r + 1.f / 6;
  y = y * r + 0.5f;
  y = y * r + 1.f;
  y = y * r + 1.f;
  return Vector(IntVector(y) + (IntVector(shifted) << 23));
}

inline Vector sigmoid(Vector x) {
  x = x < -80.f ? x * 0 - 80.f : x;
  x = x > 80.f ? x * 0 + 80.f : x;
  return 1.f / (1.f + exponential(-x));
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
      store(sigmoid(sums[o][0] + row.bias[o]), values);
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
  kernels.normalise = [](const void* in, void* out, std::size_t pixels, const BlockAffine& affine) {
    normalise(static_cast<const Stored*>(in), static_cast<Stored*>(out), pixels, affine);
  };
  kernels.normalise_to_float = [](const void* in, float* out, std::size_t pixels, const BlockAffine& affine) {
    normalise(static_cast<const Stored*>(in), out, pixels, affine);
  };
  kernels.pool_float = pool<float, Stored>;
  kernels.pool_bfloat = pool<Bfloat16, Stored>;
  kernels.picture = picture;
  kernels.shorten = [](const float* in, Bfloat16* out, std::size_t blocks) {
    for (std::size_t i = 0; i < blocks * kLanes; i += kLanes) store(load(in + i), out + i);
  };
  return kernels;
}

}  // namespace
}  // namespace lightstage::model
