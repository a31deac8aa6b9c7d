// A camera that has been opened and set up: gone with everything in it when it fails.
#pragma once

#include <memory>
#include <optional>

#include "capture/stage.h"
#include "capture/v4l2/capture_format.h"
#include "capture/v4l2/frame_interval.h"
#include "capture/v4l2/raw_to_linear.h"
#include "capture/v4l2/trigger_control.h"
#include "capture/v4l2/video_device.h"
#include "capture/v4l2/video_stream.h"

namespace lightstage::capture {

class OpenCamera {
 public:
  // Opens `node` and sets format, gain and everything automatic; does not stream yet. Throws as open_v4l2_camera.
  OpenCamera(VideoSystem& system, const std::string& node, const std::string& user, const PixelFormat& format,
             const StageCamera& camera, const CameraDevice& spec)
      : device_(system, node, user) {
    if (!device_.captures())
      device_.refuse("it delivers no pictures by streaming; `lightstage doctor` lists the cameras");
    format_ = set_format(device_, format, camera.model.width, camera.model.height);
    to_linear_.emplace(camera.name, format, spec, format_.encoding);
    switch_off_automatics(device_);
    if (spec.gain) set_gain(device_, *spec.gain);
    intervals_ = frame_intervals(device_, format.fourcc, camera.model.width, camera.model.height);
    trigger_ = find_trigger_control(device_);
  }

  const VideoDevice& device() const { return device_; }
  const BufferLayout& layout() const { return format_.layout; }
  const RawToLinear& to_linear() const { return *to_linear_; }
  const FrameIntervals& intervals() const { return intervals_; }
  const std::optional<TriggerControl>& trigger() const { return trigger_; }

  void start() { stream_ = start_stream(device_, format_.buffer_bytes); }
  void stop() { stream_.reset(); }
  VideoStream* stream() const { return stream_.get(); }

 private:
  VideoDevice device_;
  GrantedFormat format_;
  std::optional<RawToLinear> to_linear_;
  FrameIntervals intervals_;
  std::optional<TriggerControl> trigger_;
  std::unique_ptr<VideoStream> stream_;
};

}  // namespace lightstage::capture
