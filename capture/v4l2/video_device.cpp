#include "capture/v4l2/video_device.h"

#include <cerrno>
#include <cstring>
#include <system_error>

namespace lightstage::capture {

namespace {

// Text of a fixed field, which need not be terminated.
template <std::size_t size>
std::string field(const __u8 (&bytes)[size]) {
  const auto* const text = reinterpret_cast<const char*>(bytes);
  return {text, strnlen(text, size)};
}

std::string text(int error) {
  return std::generic_category().message(error);
}

std::string advice(int error) {
  switch (error) {
    case ENODEV:
    case ENXIO:
      return "; it was unplugged or its driver let go of it, plug it in again";
    case EIO:
      return "; check its cable and power, then plug it in again";
    case EBUSY:
      return "; another program uses it, close that one";
    case ENOSPC:
      return "; the USB bus has not enough bandwidth left: put the cameras on controllers of their own, or choose a "
             "smaller picture or format";
    case ENOTTY:
      return "; it is not a video device, or its driver does not have this";
    default:
      return "";
  }
}

// Errors that have another cause when a device is open already.
std::string advice_at_opening(int error) {
  switch (error) {
    case EACCES:
    case EPERM:
      return "; put this user into the group 'video' (usermod -aG video NAME) and log in again";
    case ENOENT:
      return "; is it plugged in? `lightstage doctor` lists the cameras that are there";
    default:
      return advice(error);
  }
}

}  // namespace

VideoDevice::VideoDevice(VideoSystem& system, std::string path, const std::string& user)
    : system_(system), path_(std::move(path)), name_(user.empty() ? path_ : user + " (" + path_ + ")") {
  if (const int error = system_.open(path_, descriptor_)) {
    throw VideoError(name_ + ": cannot open it: " + text(error) + advice_at_opening(error), error);
  }
  if (const int error = try_call(VIDIOC_QUERYCAP, capability_)) {
    system_.close(descriptor_);
    fail("ask what it is", error);
  }
}

std::string VideoDevice::card() const {
  return field(capability_.card);
}
std::string VideoDevice::driver() const {
  return field(capability_.driver);
}
std::string VideoDevice::bus_path() const {
  return field(capability_.bus_info);
}

bool VideoDevice::captures() const {
  // `capabilities` tells of all nodes of the device together, and metadata come from a node of their own.
  const bool of_node = capability_.capabilities & V4L2_CAP_DEVICE_CAPS;
  const __u32 capabilities = of_node ? capability_.device_caps : capability_.capabilities;
  return (capabilities & V4L2_CAP_VIDEO_CAPTURE) && (capabilities & V4L2_CAP_STREAMING);
}

void VideoDevice::fail(const std::string& action, int error) const {
  throw VideoError(name_ + ": cannot " + action + ": " + text(error) + advice(error), error);
}

void VideoDevice::refuse(const std::string& problem) const {
  throw core::DeviceError(name_ + ": " + problem);
}

}  // namespace lightstage::capture
