// Whether a camera waits for its trigger input: V4L2 has no standard control for it, drivers have one of their own.
#pragma once

#include <optional>

#include "capture/devices.h"
#include "capture/v4l2/controls.h"

namespace lightstage::capture {

struct TriggerControl {
  Control control;
  std::int64_t triggered = 1, free_running = 0;

  std::int64_t value(Exposing exposing) const { return exposing == Exposing::kTriggered ? triggered : free_running; }
};

// A switch, number from 0 or menu called "Trigger Mode", "External Trigger", "Hardware Trigger" or "Trigger Enable", however
// it is spelt. Of a menu the item that says off (disabled, free run, internal, none) and the one that says on (enabled,
// external, hardware, slave). Nothing where there is none, or its items say something else. UVC cameras have none.
std::optional<TriggerControl> find_trigger_control(const VideoDevice& device);

}  // namespace lightstage::capture
