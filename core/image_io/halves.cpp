#include "core/image_io/halves.h"

#include <Imath/half.h>

#include <algorithm>
#include <cmath>

#if defined(__x86_64__)
#include <immintrin.h>
#endif

#include "core/processor.h"

namespace lightstage::core::image_io {

namespace {

constexpr float kLargestHalf = 65504.0f;

#if defined(__x86_64__)
// Of as many values as make whole registers; returns how many. `finite` becomes false when one is not.
__attribute__((target("avx,f16c"))) std::size_t convert_eights(std::span<const float> values,
                                                               std::span<std::uint16_t> halves, bool& finite) {
  const __m256 lowest = _mm256_set1_ps(-kLargestHalf), highest = _mm256_set1_ps(kLargestHalf);
  __m256 strange = _mm256_setzero_ps();
  std::size_t i = 0;
  for (; i + 8 <= values.size(); i += 8) {
    const __m256 value = _mm256_loadu_ps(values.data() + i);
    const __m256 nothing = _mm256_sub_ps(value, value);  // NaN for what is not finite
    strange = _mm256_or_ps(strange, _mm256_cmp_ps(nothing, nothing, _CMP_UNORD_Q));
    const __m256 clamped = _mm256_min_ps(_mm256_max_ps(value, lowest), highest);
    _mm_storeu_si128(reinterpret_cast<__m128i*>(halves.data() + i),
                     _mm256_cvtps_ph(clamped, _MM_FROUND_TO_NEAREST_INT));
  }
  finite = _mm256_movemask_ps(strange) == 0;
  return i;
}

bool has_instructions() {
  static const bool has = __builtin_cpu_supports("avx") && processor_has_f16c();
  return has;
}
#endif

}  // namespace

bool to_halves_portably(std::span<const float> values, std::span<std::uint16_t> halves) {
  bool finite = true;
  for (std::size_t i = 0; i < values.size(); ++i) {
    finite = finite && std::isfinite(values[i]);
    halves[i] = Imath::half(std::clamp(values[i], -kLargestHalf, kLargestHalf)).bits();
  }
  return finite;
}

bool to_halves(std::span<const float> values, std::span<std::uint16_t> halves) {
  std::size_t done = 0;
  bool finite = true;
#if defined(__x86_64__)
  if (has_instructions()) done = convert_eights(values, halves, finite);
#endif
  return to_halves_portably(values.subspan(done), halves.subspan(done)) && finite;
}

}  // namespace lightstage::core::image_io
