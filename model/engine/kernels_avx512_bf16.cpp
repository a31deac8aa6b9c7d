// The kernels for AVX-512 with bfloat16 products; compiled with its instructions, so nothing here runs before model/engine/kernels.cpp has
// asked the processor.
#include "model/engine/instruction_sets.h"
#include "model/engine/kernel_loops.h"

namespace lightstage::model {

constinit const Kernels kAvx512Bf16Kernels = make_kernels<Bfloat16Pair>("AVX-512 bfloat16");

}  // namespace lightstage::model
