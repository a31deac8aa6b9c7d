#include "model/engine/kernels.h"

#include <vector>

#include "core/processor.h"
#include "model/engine/instruction_sets.h"

namespace lightstage::model {
namespace {

std::vector<const Kernels*> usable_kernels() {
  std::vector<const Kernels*> usable{&kPlainKernels};
#if defined(__x86_64__)
  if (__builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma") && core::processor_has_f16c()) {
    usable.push_back(&kAvx2Kernels);
  }
  if (__builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512bw") && __builtin_cpu_supports("avx512dq") &&
      __builtin_cpu_supports("avx512vl")) {
    usable.push_back(&kAvx512Kernels);
  }
#endif
  return usable;
}

}  // namespace

std::span<const Kernels* const> all_float_kernels() {
  static const std::vector<const Kernels*> usable = usable_kernels();
  return usable;
}

const Kernels& float_kernels() {
  return *all_float_kernels().back();
}

const ChannelLoops& channel_loops() {
#if defined(__x86_64__)
  if (&float_kernels() == &kAvx512Kernels) return kAvx512ChannelLoops;
  if (&float_kernels() == &kAvx2Kernels) return kAvx2ChannelLoops;
#endif
  return kPlainChannelLoops;
}

const Kernels* bfloat_kernels() {
#if defined(__x86_64__)
  if (&float_kernels() == &kAvx512Kernels && __builtin_cpu_supports("avx512bf16")) return &kAvx512Bf16Kernels;
#endif
  return nullptr;
}

}  // namespace lightstage::model
