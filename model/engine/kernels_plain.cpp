// Every processor's kernels.
#include "model/engine/channel_loops_body.h"
#include "model/engine/instruction_sets.h"
#include "model/engine/kernel_loops.h"

namespace lightstage::model {

constinit const Kernels kPlainKernels = make_kernels<Float32>("plain");
constinit const ChannelLoops kPlainChannelLoops = make_channel_loops();

}  // namespace lightstage::model
