// Exposure times in the units of V4L2: multiples of 100 microseconds.
#pragma once

#include "capture/v4l2/video_device.h"
#include "core/clock.h"

namespace lightstage::capture {

// Sets it and reads it back; the camera must be in manual mode. Throws DeviceError when the device has no exposure control
// in units of time, when the exposure is none of its steps (naming the nearest ones) and when it grants another one;
// VideoError when the driver refuses.
void set_exposure_time(const VideoDevice& device, core::Nanoseconds exposure);

}  // namespace lightstage::capture
