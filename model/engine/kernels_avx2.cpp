// The kernels for AVX2; compiled with its instructions, so nothing here runs before model/engine/kernels.cpp has asked the processor.
#include "model/engine/channel_loops_body.h"
#include "model/engine/instruction_sets.h"
#include "model/engine/kernel_loops.h"

namespace lightstage::model {

constinit const Kernels kAvx2Kernels = make_kernels<Float32>("AVX2");
constinit const ChannelLoops kAvx2ChannelLoops = make_channel_loops();

}  // namespace lightstage::model
