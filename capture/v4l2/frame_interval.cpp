#include "capture/v4l2/frame_interval.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "core/text.h"

namespace lightstage::capture {

namespace {

constexpr double kTolerance = 1e-3;

v4l2_streamparm capture_parameters() {
  v4l2_streamparm parameters{};
  parameters.type = V4L2_BUF_TYPE_VIDEO_CAPTURE;
  return parameters;
}

// Times in V4L2 are microseconds at best; rounded up, so that the time fits.
v4l2_fract whole_microseconds(core::Nanoseconds time) {
  const core::Nanoseconds us = (time + 999) / 1000;
  return {static_cast<__u32>(std::min<core::Nanoseconds>(us, std::numeric_limits<__u32>::max())), 1'000'000};
}

std::string rate(core::Nanoseconds interval) {
  return core::number_text(1e9 / static_cast<double>(interval), 5);
}

}  // namespace

core::Nanoseconds duration(v4l2_fract interval) {
  if (interval.denominator == 0) return 0;
  return std::llround(1e9 * interval.numerator / interval.denominator);
}

std::optional<v4l2_fract> FrameIntervals::at_least(core::Nanoseconds time) const {
  const auto found = std::find_if(intervals.begin(), intervals.end(),
                                  [time](v4l2_fract interval) { return duration(interval) >= time; });
  if (found == intervals.end()) return std::nullopt;
  if (is_range && found != intervals.begin()) return whole_microseconds(time);
  return *found;
}

FrameIntervals frame_intervals(const VideoDevice& device, std::uint32_t fourcc, int width, int height) {
  FrameIntervals result;
  for (__u32 i = 0;; ++i) {
    v4l2_frmivalenum query{};
    query.index = i;
    query.pixel_format = fourcc;
    query.width = static_cast<__u32>(width);
    query.height = static_cast<__u32>(height);
    if (device.try_call(VIDIOC_ENUM_FRAMEINTERVALS, query)) break;
    if (query.type != V4L2_FRMIVAL_TYPE_DISCRETE) {
      result.is_range = true;
      result.intervals = {query.stepwise.min, query.stepwise.max};
      break;
    }
    result.intervals.push_back(query.discrete);
  }
  std::erase_if(result.intervals, [](v4l2_fract interval) { return duration(interval) <= 0; });
  std::sort(result.intervals.begin(), result.intervals.end(),
            [](v4l2_fract a, v4l2_fract b) { return duration(a) < duration(b); });
  return result;
}

std::optional<core::Nanoseconds> current_frame_interval(const VideoDevice& device) {
  v4l2_streamparm parameters = capture_parameters();
  if (device.try_call(VIDIOC_G_PARM, parameters)) return std::nullopt;
  const core::Nanoseconds interval = duration(parameters.parm.capture.timeperframe);
  if (!(parameters.parm.capture.capability & V4L2_CAP_TIMEPERFRAME) || interval <= 0) return std::nullopt;
  return interval;
}

core::Nanoseconds set_frame_interval(const VideoDevice& device, v4l2_fract interval) {
  v4l2_streamparm parameters = capture_parameters();
  parameters.parm.capture.timeperframe = interval;
  const core::Nanoseconds wanted = duration(interval);
  device.call(VIDIOC_S_PARM, parameters, "set its frame rate to " + rate(wanted) + " a second");
  const core::Nanoseconds granted = duration(parameters.parm.capture.timeperframe);
  if (std::abs(static_cast<double>(granted - wanted)) > kTolerance * static_cast<double>(wanted)) {
    device.refuse("asked for " + rate(wanted) + " frames a second it grants " + (granted > 0 ? rate(granted) : "none"));
  }
  return granted;
}

}  // namespace lightstage::capture
