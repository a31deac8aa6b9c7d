// The few calls by which a program and the kernel's video drivers talk: small enough that a test can stand in for the kernel.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "core/clock.h"

namespace lightstage::capture {

// What sysfs tells of a video node without opening it.
struct VideoNode {
  std::string path;    // "/dev/video0"
  std::string card;    // the driver's name for it
  std::string serial;  // of the USB device it belongs to; empty where there is none
  int index = 0;       // among the nodes of its device; the pictures usually come from the first
};

class VideoSystem {
 public:
  virtual ~VideoSystem() = default;
  // In order of their numbers.
  virtual std::vector<VideoNode> nodes() = 0;
  // The following give 0, or the errno. Interrupted calls are made again.
  virtual int open(const std::string& path, int& descriptor) = 0;
  virtual void close(int descriptor) = 0;
  virtual int ioctl(int descriptor, unsigned long request, void* argument) = 0;
  // Waits until there is something to fetch or to report, at most `timeout` (at once when it is not above 0). `events` are
  // those of poll(2); none when the time ran out or a signal came.
  virtual int poll(int descriptor, core::Nanoseconds timeout, short& events) = 0;
  virtual int map(int descriptor, std::size_t length, std::int64_t offset, std::byte*& address) = 0;
  virtual void unmap(std::byte* address, std::size_t length) = 0;
};

// The kernel of this machine.
VideoSystem& kernel_video_system();

}  // namespace lightstage::capture
