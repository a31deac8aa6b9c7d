// A camera behind V4L2 as the session sees it: see open_v4l2_camera().
#pragma once

#include <linux/videodev2.h>

#include <memory>

#include "capture/devices.h"
#include "capture/hardware.h"
#include "capture/stage.h"
#include "capture/v4l2/pixel_format.h"
#include "capture/v4l2/sequence_counter.h"
#include "capture/v4l2/unpack.h"
#include "capture/v4l2/video_system.h"
#include "core/clock.h"

namespace lightstage::capture {

class OpenCamera;

class V4l2Camera : public Camera {
 public:
  V4l2Camera(VideoSystem& system, core::Clock& clock, StageCamera camera, CameraDevice device);
  ~V4l2Camera() override;

  std::string name() const override { return camera_.name; }
  std::optional<core::ImageSize> frame_size() const override {
    return core::ImageSize{camera_.model.height, camera_.model.width, format_.image_channels()};
  }
  void set_exposure(core::Nanoseconds exposure) override;
  void set_exposing(Exposing exposing) override;
  core::Nanoseconds frame_period() const override;
  std::optional<CameraFrame> wait_frame(core::Nanoseconds deadline) override;

 private:
  void open();
  void reopen(core::Nanoseconds deadline);
  template <class Action>
  void with_open_camera(core::Nanoseconds deadline, const Action& action);
  void start_stream();
  std::optional<v4l2_fract> longer_interval(core::Nanoseconds exposure, Exposing exposing) const;
  void set_first_interval();
  CameraFrame make_frame(const v4l2_buffer& buffer);
  struct Exposure {
    core::Nanoseconds start = 0, length = 0;
  };
  Exposure exposure_of(const v4l2_buffer& buffer) const;

  VideoSystem& system_;
  core::Clock& clock_;
  const StageCamera camera_;
  const CameraDevice device_;
  const std::string user_;  // for messages
  const PixelFormat format_;

  // What was set, to be set again after the camera was lost.
  Exposing exposing_;
  std::optional<core::Nanoseconds> exposure_;
  core::Nanoseconds interval_ = 0;  // from frame to frame; 0 where the driver does not tell

  // Frames that were exposed before the exposure was changed may still come.
  core::Nanoseconds exposure_changed_ = 0;
  std::optional<core::Nanoseconds> exposure_before_;

  SequenceCounter counter_;
  RawPicture raw_;                    // of the frame at hand
  std::unique_ptr<OpenCamera> open_;  // null after a failure
};

}  // namespace lightstage::capture
