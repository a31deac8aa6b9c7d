// The kernels and loops by instruction set; those with x86 names exist on x86-64 only.
#pragma once

#include "model/engine/channel_loops.h"
#include "model/engine/kernels.h"

namespace lightstage::model {

extern const Kernels kPlainKernels;
extern const Kernels kAvx2Kernels;
extern const Kernels kAvx512Kernels;
extern const Kernels kAvx512Bf16Kernels;

extern const ChannelLoops kPlainChannelLoops;
extern const ChannelLoops kAvx2ChannelLoops;
extern const ChannelLoops kAvx512ChannelLoops;

}  // namespace lightstage::model
