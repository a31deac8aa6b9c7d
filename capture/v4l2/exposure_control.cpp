#include "capture/v4l2/exposure_control.h"

#include "capture/v4l2/controls.h"
#include "core/text.h"

namespace lightstage::capture {

namespace {

constexpr core::Nanoseconds kUnit = 100'000;

std::string milliseconds(core::Nanoseconds time) {
  return core::number_text(static_cast<double>(time) / 1e6) + " ms";
}

}  // namespace

void set_exposure_time(const VideoDevice& device, core::Nanoseconds exposure) {
  const std::optional<Control> control = find_control(device, V4L2_CID_EXPOSURE_ABSOLUTE);
  if (!control || !control->writable()) {
    const bool has_other = find_control(device, V4L2_CID_EXPOSURE).has_value();
    device.refuse(std::string("cannot set exposure times: its driver has ") +
                  (has_other ? "an exposure control in units of its own only, none in units of time"
                             : "no exposure control that can be written") +
                  "; use another camera or driver");
  }
  const core::Nanoseconds shortest = control->minimum * kUnit, longest = control->maximum * kUnit;
  const core::Nanoseconds step = control->step * kUnit;
  const std::string choices = "exposures go from " + milliseconds(shortest) + " to " + milliseconds(longest) +
                              " in steps of " + milliseconds(step) + ", so that " + milliseconds(exposure) +
                              " cannot be had";
  if (exposure < shortest || exposure > longest) device.refuse(choices);
  if (const core::Nanoseconds excess = (exposure - shortest) % step; excess != 0) {
    const core::Nanoseconds below = exposure - excess;
    const std::string above = below + step <= longest ? " and " + milliseconds(below + step) : "";
    device.refuse(choices + "; the nearest are " + milliseconds(below) + above);
  }
  set_control(device, *control, exposure / kUnit);
}

}  // namespace lightstage::capture
