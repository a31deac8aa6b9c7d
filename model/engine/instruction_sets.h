// The kernels by instruction set; those with x86 names exist on x86-64 only.
#pragma once

#include "model/engine/kernels.h"

namespace lightstage::model {

extern const Kernels kPlainKernels;
extern const Kernels kAvx2Kernels;
extern const Kernels kAvx512Kernels;
extern const Kernels kAvx512Bf16Kernels;

}  // namespace lightstage::model
