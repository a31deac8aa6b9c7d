// 16 lanes of float32, as one, two or four of the instruction set's registers; for model/engine/kernel_loops.h alone, and local to the
// source file for the same reason.
#pragma once

#include <cstddef>
#include <cstdint>
#include <cstring>

#if defined(__x86_64__)
#include <immintrin.h>
#endif

#include "model/engine/kernels.h"

namespace lightstage::model {
namespace {

#if defined(__AVX512F__)
constexpr int kPartLanes = 16;
#elif defined(__AVX2__)
constexpr int kPartLanes = 8;
#else
constexpr int kPartLanes = 4;
#endif
constexpr int kParts = kLanes / kPartLanes;

typedef float Part __attribute__((vector_size(4 * kPartLanes)));
typedef double DoublePart __attribute__((vector_size(8 * kPartLanes)));
typedef std::int32_t IntPart __attribute__((vector_size(4 * kPartLanes)));
typedef std::uint32_t UintPart __attribute__((vector_size(4 * kPartLanes)));
typedef std::uint16_t ShortPart __attribute__((vector_size(2 * kPartLanes)));

struct Vector {
  Part part[kParts];
};

#define LIGHTSTAGE_INLINE [[gnu::always_inline]] inline

// result.part[i] = of(i)
template <class Of>
LIGHTSTAGE_INLINE Vector by_parts(const Of& of) {
  Vector result;
#pragma GCC unroll 4
  for (int i = 0; i < kParts; ++i) result.part[i] = of(i);
  return result;
}

LIGHTSTAGE_INLINE Vector operator+(const Vector& a, const Vector& b) {
  return by_parts([&](int i) { return a.part[i] + b.part[i]; });
}
LIGHTSTAGE_INLINE Vector operator-(const Vector& a, const Vector& b) {
  return by_parts([&](int i) { return a.part[i] - b.part[i]; });
}
LIGHTSTAGE_INLINE Vector operator*(const Vector& a, const Vector& b) {
  return by_parts([&](int i) { return a.part[i] * b.part[i]; });
}
LIGHTSTAGE_INLINE Vector operator*(const Vector& a, float b) {
  return by_parts([&](int i) { return a.part[i] * b; });
}
LIGHTSTAGE_INLINE Vector& operator+=(Vector& a, const Vector& b) {
  return a = a + b;
}
LIGHTSTAGE_INLINE Vector broadcast(float value) {
  return by_parts([&](int) { return Part{} + value; });
}

template <class Piece>
LIGHTSTAGE_INLINE Piece read(const void* p) {
  Piece piece;
  std::memcpy(&piece, p, sizeof piece);
  return piece;
}

LIGHTSTAGE_INLINE Vector load(const float* p) {
  return by_parts([&](int i) { return read<Part>(p + i * kPartLanes); });
}
LIGHTSTAGE_INLINE void store(const Vector& v, float* p) {
  std::memcpy(p, &v, sizeof v);
}

// Past the caches; to 64-byte aligned addresses.
LIGHTSTAGE_INLINE void stream(const Vector& v, float* p) {
#pragma GCC unroll 4
  for (int i = 0; i < kParts; ++i) {
#if defined(__AVX512F__)
    _mm512_stream_ps(p + i * kPartLanes, v.part[i]);
#elif defined(__AVX2__)
    _mm256_stream_ps(p + i * kPartLanes, v.part[i]);
#elif defined(__x86_64__)
    _mm_stream_ps(p + i * kPartLanes, v.part[i]);
#else
    std::memcpy(p + i * kPartLanes, &v.part[i], sizeof v.part[i]);
#endif
  }
}

#if defined(__AVX512BF16__)
// Rounded to the nearest, ties to even.
LIGHTSTAGE_INLINE void store(const Vector& v, Bfloat16* p) {
  const __m256bh halves = _mm512_cvtneps_pbh(v.part[0]);
  std::memcpy(p, &halves, sizeof halves);
}
#endif

LIGHTSTAGE_INLINE Part part_of(ShortPart halves) {
#if defined(__AVX512F__)
  return _mm512_maskz_cvtph_ps(0xffff, __m256i(halves));
#elif defined(__F16C__)
  return _mm256_cvtph_ps(__m128i(halves));
#else
  // The exponent of a half counts from 2^-15, that of a float from 2^-127: the same bits, shifted, mean 2^-112 times the value.
  const UintPart bits = __builtin_convertvector(halves, UintPart), magnitude = bits & 0x7fff;
  const UintPart value = UintPart(Part(magnitude << 13) * 0x1p112f);
  const UintPart infinite = UintPart(magnitude >= 0x7c00) & 0x7f800000;  // and NaN
  return Part(value | infinite | ((bits & 0x8000) << 16));
#endif
}
// To the nearest, ties to even; |x| <= 65504, or NaN.
LIGHTSTAGE_INLINE ShortPart halves_of(Part x) {
#if defined(__AVX512F__)
  return ShortPart(_mm512_maskz_cvtps_ph(0xffff, x, _MM_FROUND_TO_NEAREST_INT));
#elif defined(__F16C__)
  return ShortPart(_mm256_cvtps_ph(x, _MM_FROUND_TO_NEAREST_INT));
#else
  const UintPart sign = UintPart(x) & 0x80000000;
  const UintPart bits = UintPart(Part(UintPart(x) ^ sign) * 0x1p-112f);
  return __builtin_convertvector(((bits + 0xfff + ((bits >> 13) & 1)) >> 13) | (sign >> 16), ShortPart);
#endif
}

LIGHTSTAGE_INLINE Vector load(const Float16* p) {
  return by_parts([&](int i) { return part_of(read<ShortPart>(p + i * kPartLanes)); });
}
LIGHTSTAGE_INLINE void store(const Vector& v, Float16* p) {
  const Part low = Part{} - 65504.f, high = Part{} + 65504.f;
#pragma GCC unroll 4
  for (int i = 0; i < kParts; ++i) {
    Part x = v.part[i];
    x = x < low ? low : x;
    x = x > high ? high : x;
    const ShortPart halves = halves_of(x);
    std::memcpy(p + i * kPartLanes, &halves, sizeof halves);
  }
}

// totals[lane] += v[lane]
LIGHTSTAGE_INLINE void add_to(const Vector& v, double* totals) {
#pragma GCC unroll 4
  for (int i = 0; i < kParts; ++i) {
    const DoublePart sum = read<DoublePart>(totals + i * kPartLanes) + __builtin_convertvector(v.part[i], DoublePart);
    std::memcpy(totals + i * kPartLanes, &sum, sizeof sum);
  }
}

LIGHTSTAGE_INLINE Vector prelu(const Vector& z, const Vector& slope) {
  return by_parts([&](int i) { return z.part[i] > 0 ? z.part[i] : z.part[i] * slope.part[i]; });
}

LIGHTSTAGE_INLINE Part fold(Part a, Part b) {
#if defined(__AVX512F__)
  return __builtin_shufflevector(a, b, 0, 2, 4, 6, 8, 10, 12, 14, 16, 18, 20, 22, 24, 26, 28, 30) +
         __builtin_shufflevector(a, b, 1, 3, 5, 7, 9, 11, 13, 15, 17, 19, 21, 23, 25, 27, 29, 31);
#elif defined(__AVX2__)
  return __builtin_shufflevector(a, b, 0, 2, 4, 6, 8, 10, 12, 14) +
         __builtin_shufflevector(a, b, 1, 3, 5, 7, 9, 11, 13, 15);
#else
  return __builtin_shufflevector(a, b, 0, 2, 4, 6) + __builtin_shufflevector(a, b, 1, 3, 5, 7);
#endif
}
// Sums of neighbours: those of a in the lower half, those of b in the upper.
LIGHTSTAGE_INLINE Vector fold(const Vector& a, const Vector& b) {
  return by_parts([&](int i) {
    const Vector& from = 2 * i < kParts ? a : b;
    if constexpr (kParts == 1) return fold(a.part[0], b.part[0]);
    return fold(from.part[2 * i % kParts], from.part[(2 * i + 1) % kParts]);
  });
}

// exp(x) by exp(n ln 2) exp(r), |r| <= ln(2)/2: relative error below 2e-7. x within +-87.
LIGHTSTAGE_INLINE Part exponential(Part x) {
  constexpr float kMagic = 12582912;  // 1.5 * 2^23: adding it leaves a number rounded to an integer in the lowest bits
  const Part shifted = x * 1.44269504f + kMagic;
  const Part n = shifted - kMagic;
  const Part r = (x - n * 0.693359375f) + n * 2.12194440e-4f;
  Part y = r * (1.f / 5040) + 1.f / 720;
  y = y * r + 1.f / 120;
  y = y * r + 1.f / 24;
  y = y * r + 1.f / 6;
  y = y * r + 0.5f;
  y = y * r + 1.f;
  y = y * r + 1.f;
  return Part(IntPart(y) + (IntPart(shifted) << 23));
}

LIGHTSTAGE_INLINE Vector sigmoid(const Vector& v) {
  return by_parts([&](int i) {
    const Part low = Part{} - 80.f, high = Part{} + 80.f;
    Part x = v.part[i];
    x = x < low ? low : x;
    x = x > high ? high : x;
    return 1.f / (1.f + exponential(-x));
  });
}

#undef LIGHTSTAGE_INLINE

}  // namespace
}  // namespace lightstage::model
