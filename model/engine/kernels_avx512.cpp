// The kernels for AVX-512; compiled with its instructions, so nothing here runs before model/engine/kernels.cpp has asked the processor.
#include "model/engine/channel_loops_body.h"
#include "model/engine/instruction_sets.h"
#include "model/engine/kernel_loops.h"

namespace lightstage::model {

constinit const Kernels kAvx512Kernels = make_kernels<Float32>("AVX-512");
constinit const ChannelLoops kAvx512ChannelLoops = make_channel_loops();

}  // namespace lightstage::model
