// Cameras run free; lights follow them.
#pragma once

#include "capture/session/pass.h"

namespace lightstage::capture {

// Takes every frame that is missing. Each light stays on for one whole exposure of every camera, as far as can be told
// from where the exposures of before lay; which frame that was is found when it has arrived (frame_matcher.h, witness.h). Steps
// whose frame was lost or is not certain are lit again, each at most SessionOptions::attempts times.
//
// Throws DeviceError as measure_free_running, and when a step's frame is not had.
void run_free(Pass& pass);

}  // namespace lightstage::capture
