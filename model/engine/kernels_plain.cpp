// Every processor's kernels.
#include "model/engine/instruction_sets.h"
#include "model/engine/kernel_loops.h"

namespace lightstage::model {

constinit const Kernels kPlainKernels = make_kernels<Float32>("plain");

}  // namespace lightstage::model
