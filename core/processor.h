// What the processor can do beyond what every x86-64 can.
#pragma once

#if defined(__x86_64__)
#include <cpuid.h>
#endif

namespace lightstage::core {

// Conversions between float32 and binary16 (Intel SDM, volume 2, CPUID leaf 1, ECX bit 29). __builtin_cpu_supports knows this one only in GCC.
inline bool processor_has_f16c() {
#if defined(__x86_64__)
  unsigned eax = 0, ebx = 0, ecx = 0, edx = 0;
  return __get_cpuid(1, &eax, &ebx, &ecx, &edx) != 0 && (ecx & bit_F16C) != 0;
#else
  return false;
#endif
}

}  // namespace lightstage::core
