// The plain way: light, settle, trigger, wait for every frame.
#pragma once

#include "capture/session/pass.h"

namespace lightstage::capture {

// Takes every frame that is missing. A frame belongs to a step only when its time stamp is not before the trigger and its
// sequence number is higher than all that the camera sent before. The lights change only after every frame has come or is given
// up. After a frame was given up nothing is exposed for as long again, and once more before the lights change: a late frame
// finds nothing that it could be taken for.
void run_lockstep(Pass& pass);

}  // namespace lightstage::capture
