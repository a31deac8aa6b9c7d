// Times from frame to frame that a camera offers.
#pragma once

#include <optional>
#include <vector>

#include "capture/v4l2/video_device.h"
#include "core/clock.h"

namespace lightstage::capture {

// Rounded to the nearest nanosecond; 0 for a fraction that means nothing.
core::Nanoseconds duration(v4l2_fract interval);

struct FrameIntervals {
  // From short to long. Where the driver gives a range: its two ends.
  std::vector<v4l2_fract> intervals;
  bool is_range = false;

  // The shortest that is not shorter than `time`; nothing when all are.
  std::optional<v4l2_fract> at_least(core::Nanoseconds time) const;
};

// Empty where the driver does not tell.
FrameIntervals frame_intervals(const VideoDevice& device, std::uint32_t fourcc, int width, int height);

// The one set, or nothing where the driver does not tell.
std::optional<core::Nanoseconds> current_frame_interval(const VideoDevice& device);

// Sets it, and returns the one granted. Throws DeviceError naming both when they differ by more than a thousandth, VideoError
// when the driver refuses (most do while they stream).
core::Nanoseconds set_frame_interval(const VideoDevice& device, v4l2_fract interval);

}  // namespace lightstage::capture
