#include "capture/v4l2/v4l2_camera.h"

#include <algorithm>

#include "capture/v4l2/enumerate.h"
#include "capture/v4l2/exposure_control.h"
#include "capture/v4l2/open_camera.h"
#include "core/error.h"
#include "core/text.h"

namespace lightstage::capture {

namespace {

// A USB camera that was plugged in again is there after about a second.
constexpr core::Nanoseconds kPatience = 3 * core::kSecond;
constexpr core::Nanoseconds kLookEvery = 20 * core::kMillisecond;
constexpr core::Nanoseconds kExposureBeforeSet = core::kSecond;
constexpr int kSmallestMosaic = 4;

PixelFormat measurable_format(const std::string& user, const StageCamera& camera, const CameraDevice& device) {
  const auto fail = [&](const std::string& problem) {
    throw core::BadInput(user + ": " + problem + "; correct the stage file");
  };
  const std::optional<std::uint32_t> fourcc = parse_fourcc(device.pixel_format);
  if (!fourcc) fail("'" + device.pixel_format + "' is not a pixel format of four characters");
  const std::optional<PixelFormat> format = find_pixel_format(*fourcc);
  if (!format) fail("pixel format " + device.pixel_format + " is refused: " + refusal(*fourcc));
  const int smallest = format->bayer ? kSmallestMosaic : 1;
  if (std::min(camera.model.width, camera.model.height) < smallest) fail("its picture is too small");
  return *format;
}

std::string milliseconds(core::Nanoseconds time) {
  return core::number_text(static_cast<double>(time) / 1e6, 6) + " ms";
}

}  // namespace

int picture_channels(const CameraDevice& device) {
  const std::optional<std::uint32_t> fourcc = parse_fourcc(device.pixel_format);
  const std::optional<PixelFormat> format = fourcc ? find_pixel_format(*fourcc) : std::nullopt;
  if (!format)
    throw core::BadInput("pixel format " + device.pixel_format + " cannot be measured in; correct the stage file");
  return format->image_channels();
}

V4l2Camera::V4l2Camera(VideoSystem& system, core::Clock& clock, StageCamera camera, CameraDevice device)
    : system_(system),
      clock_(clock),
      camera_(std::move(camera)),
      device_(std::move(device)),
      user_("camera '" + camera_.name + "'"),
      format_(measurable_format(user_, camera_, device_)),
      exposing_(device_.triggered ? Exposing::kTriggered : Exposing::kFreeRunning) {
  open();
}

V4l2Camera::~V4l2Camera() = default;

void V4l2Camera::open() {
  const std::string node = find_camera_node(system_, device_.match, format_.fourcc, user_);
  open_ = std::make_unique<OpenCamera>(system_, node, user_, format_, camera_, device_);
  try {
    if (open_->trigger()) set_control(open_->device(), open_->trigger()->control, open_->trigger()->value(exposing_));
    set_first_interval();
    if (exposure_) set_exposure_time(open_->device(), *exposure_);
    start_stream();
  } catch (...) {
    open_.reset();
    throw;
  }
}

void V4l2Camera::reopen(core::Nanoseconds deadline) {
  for (;;) {
    try {
      return open();
    } catch (const core::DeviceError&) {
      if (clock_.now() >= deadline) throw;
    }
    clock_.sleep_until(std::min(deadline, clock_.now() + kLookEvery));
  }
}

template <class Action>
void V4l2Camera::with_open_camera(core::Nanoseconds deadline, const Action& action) {
  if (!open_) reopen(deadline);
  try {
    action();
  } catch (const VideoError&) {
    open_.reset();
    throw;
  } catch (...) {
    if (!open_->stream()) open_.reset();  // refused between two streams
    throw;
  }
}

void V4l2Camera::start_stream() {
  counter_.restart();
  open_->start();
}

// The one to be set for this exposure; nothing when the present one will do. Never goes back to a faster rate: two exposures
// that take turns would stop the stream at each change.
std::optional<v4l2_fract> V4l2Camera::longer_interval(core::Nanoseconds exposure, Exposing exposing) const {
  const bool runs_free = exposing == Exposing::kFreeRunning;
  const VideoDevice& device = open_->device();
  // A trigger can leave any time between two exposures.
  if (runs_free && interval_ == 0) device.refuse("its driver does not tell its frame rate: it cannot run free");
  if (exposure <= interval_ || interval_ == 0) return std::nullopt;
  const FrameIntervals& offered = open_->intervals();
  if (const std::optional<v4l2_fract> long_enough = offered.at_least(exposure)) return long_enough;
  const core::Nanoseconds longest = offered.intervals.empty() ? interval_ : duration(offered.intervals.back());
  if (runs_free) {
    device.refuse("running free it gives a frame every " + milliseconds(longest) +
                  " at its slowest, which is no time " + "for an exposure of " + milliseconds(exposure) +
                  "; expose for less");
  }
  if (longest <= interval_) return std::nullopt;
  return offered.intervals.back();
}

// After opening, before streaming.
void V4l2Camera::set_first_interval() {
  const VideoDevice& device = open_->device();
  const std::optional<core::Nanoseconds> current = current_frame_interval(device);
  const FrameIntervals& offered = open_->intervals();
  if (!current || offered.intervals.empty()) {
    interval_ = current.value_or(0);
  } else {
    const v4l2_fract wanted = offered.at_least(interval_).value_or(offered.intervals.back());
    interval_ = duration(wanted) == *current ? *current : set_frame_interval(device, wanted);
  }
  // Throws where the camera cannot run free at all.
  if (const auto longer = longer_interval(exposure_.value_or(0), exposing_))
    interval_ = set_frame_interval(device, *longer);
}

void V4l2Camera::set_exposure(core::Nanoseconds exposure) {
  with_open_camera(clock_.now() + kPatience, [&] {
    const VideoDevice& device = open_->device();
    if (const std::optional<v4l2_fract> longer = longer_interval(exposure, exposing_)) {
      open_->stop();
      interval_ = set_frame_interval(device, *longer);
      set_exposure_time(device, exposure);
      start_stream();
    } else {
      set_exposure_time(device, exposure);
    }
  });
  exposure_before_ = exposure_;
  exposure_ = exposure;
  exposure_changed_ = clock_.now();
}

void V4l2Camera::set_exposing(Exposing exposing) {
  if (exposing == Exposing::kTriggered && !device_.triggered) {
    throw core::DeviceError(user_ +
                            " exposes on its own, says the stage file (triggered = false): choose timing free_run, or "
                            "wire its trigger input and correct the stage file");
  }
  if (exposing == exposing_) return;
  with_open_camera(clock_.now() + kPatience, [&] {
    if (!open_->trigger()) {
      open_->device().refuse(
          "its driver has no control that switches it from triggered to free running; switch it by its "
          "maker's tool and write triggered = false into the stage file, or choose another timing");
    }
    const std::optional<v4l2_fract> longer = longer_interval(exposure_.value_or(0), exposing);
    open_->stop();
    if (longer) interval_ = set_frame_interval(open_->device(), *longer);
    set_control(open_->device(), open_->trigger()->control, open_->trigger()->value(exposing));
    start_stream();
    exposing_ = exposing;
  });
}

core::Nanoseconds V4l2Camera::frame_period() const {
  return std::max(interval_, exposure_.value_or(0));
}

std::optional<CameraFrame> V4l2Camera::wait_frame(core::Nanoseconds deadline) {
  std::optional<CameraFrame> frame;
  with_open_camera(deadline, [&] {
    std::optional<v4l2_buffer> filled;
    open_->stream()->fetch(deadline, clock_, [&](const v4l2_buffer& buffer, std::span<const std::byte> bytes) {
      unpack(bytes, open_->layout(), raw_);
      filled = buffer;
    });
    if (filled) frame = make_frame(*filled);
  });
  return frame;
}

CameraFrame V4l2Camera::make_frame(const v4l2_buffer& buffer) {
  const auto [start, exposure] = exposure_of(buffer);
  const double radiance_per_signal = 1 / (camera_.responsivity * static_cast<double>(exposure) * 1e-9);
  CameraFrame frame;
  frame.image = open_->to_linear().image(raw_, radiance_per_signal);
  frame.saturation = open_->to_linear().top_signal() * radiance_per_signal;
  frame.sequence_number = counter_.number_of(buffer.sequence);
  frame.timestamp = start;
  frame.damaged = (buffer.flags & V4L2_BUF_FLAG_ERROR) || buffer.bytesused < open_->layout().picture_bytes();
  return frame;
}

V4l2Camera::Exposure V4l2Camera::exposure_of(const v4l2_buffer& buffer) const {
  if ((buffer.flags & V4L2_BUF_FLAG_TIMESTAMP_MASK) != V4L2_BUF_FLAG_TIMESTAMP_MONOTONIC) {
    open_->device().refuse(
        "its driver does not stamp frames by the monotonic clock, so that they cannot be matched to lights; use "
        "another "
        "driver or camera");
  }
  const core::Nanoseconds stamp = core::Nanoseconds(buffer.timestamp.tv_sec) * core::kSecond +
                                  core::Nanoseconds(buffer.timestamp.tv_usec) * 1000 + device_.timestamp_offset;
  const bool is_start = (buffer.flags & V4L2_BUF_FLAG_TSTAMP_SRC_MASK) == V4L2_BUF_FLAG_TSTAMP_SRC_SOE;
  const auto taken_with = [&](std::optional<core::Nanoseconds> exposure) {
    return Exposure{is_start ? stamp : stamp - exposure.value_or(0), exposure.value_or(kExposureBeforeSet)};
  };
  const Exposure now = taken_with(exposure_);
  return now.start < exposure_changed_ ? taken_with(exposure_before_) : now;
}

std::unique_ptr<Camera> open_v4l2_camera(const StageCamera& camera, const CameraDevice& device, core::Clock& clock) {
  return std::make_unique<V4l2Camera>(kernel_video_system(), clock, camera, device);
}

}  // namespace lightstage::capture
