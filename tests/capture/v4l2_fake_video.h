// A kernel with V4L2 cameras that do what a test says, in virtual time.
#pragma once

#include <linux/videodev2.h>

#include <deque>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "capture/v4l2/video_system.h"
#include "core/clock.h"

namespace lightstage::test {

struct FakeControl {
  std::string name;
  std::uint32_t type = V4L2_CTRL_TYPE_INTEGER;
  std::int64_t minimum = 0, maximum = 1, step = 1, value = 0;
  std::uint32_t flags = 0;
  std::map<std::int64_t, std::string> menu = {};
  std::optional<std::int64_t> grants = {};  // whatever is asked for; otherwise clamped
};

struct FakeFrame {
  std::vector<std::byte> bytes;
  std::uint32_t sequence = 0;
  core::Nanoseconds timestamp = 0;
  core::Nanoseconds ready = 0;
  std::uint32_t flags = V4L2_BUF_FLAG_TIMESTAMP_MONOTONIC | V4L2_BUF_FLAG_TSTAMP_SRC_SOE;
};

// One video node.
struct FakeCamera {
  capture::VideoNode node;
  std::string card = "Fake camera", driver = "fake", bus_path = "usb-0000:00:14.0-1";
  std::uint32_t device_caps = V4L2_CAP_VIDEO_CAPTURE | V4L2_CAP_STREAMING;
  std::vector<std::uint32_t> formats;
  std::vector<std::pair<std::uint32_t, std::uint32_t>> sizes;
  std::vector<v4l2_fract> intervals;  // of every size, as listed
  bool interval_range = false;
  std::map<std::uint32_t, FakeControl> controls;
  // What S_FMT makes of a request, after the fields were filled in.
  std::function<void(v4l2_pix_format&)> grant_format = [](v4l2_pix_format&) {};
  std::optional<v4l2_fract> grant_interval;
  bool has_mmap = true;
  std::size_t row_padding = 0;

  // Faults: the next calls of this request end with these errors (0: as usual).
  std::map<unsigned long, std::deque<int>> errors;
  int open_error = 0;
  bool gone = false;      // unplugged: everything is ENODEV
  short poll_events = 0;  // on top of what poll would say

  // State.
  std::deque<FakeFrame> frames;  // on their way to buffers
  v4l2_pix_format format{};
  v4l2_fract interval{1, 30};
  bool streaming = false;
  int opened = 0, stream_starts = 0;
  std::deque<std::uint32_t> queued;
  std::uint32_t memory = 0;
  std::vector<std::vector<std::byte>> mapped;
  std::map<std::uint32_t, std::span<std::byte>> user;
};

class FakeVideo : public capture::VideoSystem {
 public:
  explicit FakeVideo(core::VirtualClock& clock) : clock_(clock) {}

  // In the order in which the kernel lists them. Cameras stay where they are.
  std::vector<std::shared_ptr<FakeCamera>> cameras;
  // Called before each listing: may change anything (plug a camera in).
  std::function<void()> on_list = [] {};
  int open_descriptors() const { return static_cast<int>(descriptors_.size()); }
  int mappings() const { return mappings_; }

  std::vector<capture::VideoNode> nodes() override;
  int open(const std::string& path, int& descriptor) override;
  void close(int descriptor) override;
  int ioctl(int descriptor, unsigned long request, void* argument) override;
  int poll(int descriptor, core::Nanoseconds timeout, short& events) override;
  int map(int descriptor, std::size_t length, std::int64_t offset, std::byte*& address) override;
  void unmap(std::byte* address, std::size_t length) override;

 private:
  core::VirtualClock& clock_;
  std::map<int, std::shared_ptr<FakeCamera>> descriptors_;
  int next_descriptor_ = 3, mappings_ = 0;
};

// A UVC-like camera with manual exposure (0.1 to 500 ms), gain, and everything automatic switched on.
std::shared_ptr<FakeCamera> uvc_camera(const std::string& path, const std::string& serial, const std::string& bus_path);

// `value` in every pixel of a grey format of `bytes_per_value`.
std::vector<std::byte> flat_picture(int width, int height, int bytes_per_value, int value, std::size_t row_padding = 0);

}  // namespace lightstage::test
