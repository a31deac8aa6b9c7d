// Devices that come back after they were unplugged.
#pragma once

#include <functional>

#include "core/clock.h"

namespace lightstage::capture {

// Calls `open` until it throws no DeviceError, for 3 s: a chip that is plugged in again, and udev's setting of its
// permissions, takes a while. Throws the last error, and Interrupted on Ctrl-C.
void reopen(core::Clock& clock, const std::function<void()>& open);

}  // namespace lightstage::capture
