// Exposures follow each other while frames travel; the controller steps by itself.
#pragma once

#include "capture/session/pass.h"

namespace lightstage::capture {

// Takes what can be had that way; what is left (lost frames, frames whose step is not certain, steps after a strobe that was
// not heard) is for run_lockstep. The controller holds the patterns of all steps and lights the next one when the first
// camera's exposure ends (by its strobe), plus the time that triggering takes and Sequence::hold. The next trigger waits for
// that, for the lights to settle, and for the cameras' frame period; not for the frame.
//
// Throws UsageError where the controller cannot hold a sequence, DeviceError as measure_triggered.
void run_pipelined(Pass& pass);

}  // namespace lightstage::capture
