#include "hil/scenarios/vivid.h"

#include <fcntl.h>
#include <linux/videodev2.h>
#include <sys/ioctl.h>
#include <unistd.h>

#include <stdexcept>

#include "capture/v4l2_cameras.h"

namespace lightstage::hil {

namespace {

// As the driver names its devices.
std::string bus_path(int index) {
  return "platform:vivid-00" + std::to_string(index);
}

// Opened for each use: while somebody holds it open, a disconnected device does not come back.
class OpenNode {
 public:
  explicit OpenNode(const std::string& node) : fd_(open(node.c_str(), O_RDWR | O_CLOEXEC)) {
    if (fd_ < 0) throw std::runtime_error("cannot open " + node);
  }
  ~OpenNode() { close(fd_); }
  OpenNode(const OpenNode&) = delete;
  OpenNode& operator=(const OpenNode&) = delete;

  template <typename Argument>
  bool call(unsigned long request, Argument& argument) const {
    return ioctl(fd_, request, &argument) == 0;
  }

  v4l2_queryctrl find(const std::string& control) const {
    v4l2_queryctrl query{};
    query.id = V4L2_CTRL_FLAG_NEXT_CTRL;
    for (; call(VIDIOC_QUERYCTRL, query); query.id |= V4L2_CTRL_FLAG_NEXT_CTRL) {
      if (control == reinterpret_cast<const char*>(query.name)) return query;
    }
    throw std::runtime_error("vivid has no control '" + control + "'");
  }

 private:
  int fd_;
};

}  // namespace

Vivid::Vivid(int index) : index_(index) {
  for (const capture::V4l2CameraSeen& seen : capture::v4l2_cameras_seen()) {
    if (seen.bus_path == bus_path(index)) node_ = seen.node;
  }
  // Left alone the driver stamps frames with a time that is still to come.
  set("Timestamp Source", 1);
  choose("OSD Text Mode", "None");
}

void Vivid::set(const std::string& control, int value) {
  const OpenNode node(node_);
  v4l2_control request{node.find(control).id, value};
  if (!node.call(VIDIOC_S_CTRL, request)) throw std::runtime_error("vivid refuses '" + control + "'");
}

void Vivid::choose(const std::string& control, const std::string& item) {
  const OpenNode node(node_);
  const v4l2_queryctrl query = node.find(control);
  for (int i = query.minimum; i <= query.maximum; ++i) {
    v4l2_querymenu menu{};
    menu.id = query.id;
    menu.index = static_cast<std::uint32_t>(i);
    if (!node.call(VIDIOC_QUERYMENU, menu) || item != reinterpret_cast<const char*>(menu.name)) continue;
    v4l2_control request{query.id, i};
    if (node.call(VIDIOC_S_CTRL, request)) return;
  }
  throw std::runtime_error("vivid's '" + control + "' has no '" + item + "'");
}

capture::StageCamera Vivid::camera(int width, int height) const {
  capture::StageCamera camera;
  camera.name = "vivid" + std::to_string(index_);
  camera.model.width = width;
  camera.model.height = height;
  return camera;
}

capture::CameraDevice Vivid::device(const std::string& pixel_format) const {
  capture::CameraDevice device;
  device.match = bus_path(index_);
  device.pixel_format = pixel_format;
  return device;
}

}  // namespace lightstage::hil
