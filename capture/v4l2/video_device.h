// An open video node.
#pragma once

#include <linux/videodev2.h>

#include <string>

#include "capture/v4l2/video_system.h"
#include "core/error.h"

namespace lightstage::capture {

// What the kernel refused, with its errno. After one the device's state is not known: close it and open it again.
struct VideoError : core::DeviceError {
  VideoError(const std::string& message, int error_number) : core::DeviceError(message), error(error_number) {}
  int error;
};

class VideoDevice {
 public:
  // Opens and asks what it is. `user` goes before the path in every message ("camera 'left'"); may be empty. Throws
  // VideoError.
  VideoDevice(VideoSystem& system, std::string path, const std::string& user);
  ~VideoDevice() { system_.close(descriptor_); }
  VideoDevice(const VideoDevice&) = delete;
  VideoDevice& operator=(const VideoDevice&) = delete;

  VideoSystem& system() const { return system_; }
  int descriptor() const { return descriptor_; }
  const std::string& path() const { return path_; }
  const std::string& name() const { return name_; }  // for messages

  std::string card() const;
  std::string driver() const;
  std::string bus_path() const;
  // Delivers pictures by streaming: of a camera's nodes there is usually one that does.
  bool captures() const;

  // 0, or the errno.
  template <class Argument>
  int try_call(unsigned long request, Argument& argument) const {
    return system_.ioctl(descriptor_, request, &argument);
  }
  // Throws VideoError: "NAME: cannot ACTION: what the kernel says; what to do".
  template <class Argument>
  void call(unsigned long request, Argument& argument, const std::string& action) const {
    if (const int error = try_call(request, argument)) fail(action, error);
  }
  [[noreturn]] void fail(const std::string& action, int error) const;
  // Something that the device does, but not as it should.
  [[noreturn]] void refuse(const std::string& problem) const;

 private:
  VideoSystem& system_;
  std::string path_, name_;
  int descriptor_ = -1;
  v4l2_capability capability_{};
};

}  // namespace lightstage::capture
