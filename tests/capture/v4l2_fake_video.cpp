#include "v4l2_fake_video.h"

#include <poll.h>

#include <algorithm>
#include <cerrno>
#include <cstring>

namespace lightstage::test {

namespace {

template <std::size_t size>
void put(__u8 (&field)[size], const std::string& text) {
  std::memset(field, 0, size);
  std::memcpy(field, text.data(), std::min(text.size(), size));
}

bool same(v4l2_fract a, v4l2_fract b) {
  return std::uint64_t(a.numerator) * b.denominator == std::uint64_t(b.numerator) * a.denominator;
}

int query_capability(const FakeCamera& camera, v4l2_capability& result) {
  result = {};
  put(result.card, camera.card);
  put(result.driver, camera.driver);
  put(result.bus_info, camera.bus_path);
  result.device_caps = camera.device_caps;
  result.capabilities = camera.device_caps | V4L2_CAP_DEVICE_CAPS | V4L2_CAP_VIDEO_CAPTURE | V4L2_CAP_META_CAPTURE;
  return 0;
}

int enumerate_format(const FakeCamera& camera, v4l2_fmtdesc& query) {
  if (query.index >= camera.formats.size()) return EINVAL;
  query.pixelformat = camera.formats[query.index];
  put(query.description, "format " + std::to_string(query.index));
  return 0;
}

int enumerate_size(const FakeCamera& camera, v4l2_frmsizeenum& query) {
  if (query.index >= camera.sizes.size()) return EINVAL;
  query.type = V4L2_FRMSIZE_TYPE_DISCRETE;
  query.discrete = {camera.sizes[query.index].first, camera.sizes[query.index].second};
  return 0;
}

int enumerate_interval(const FakeCamera& camera, v4l2_frmivalenum& query) {
  if (camera.interval_range) {
    if (query.index > 0) return EINVAL;
    query.type = V4L2_FRMIVAL_TYPE_CONTINUOUS;
    query.stepwise = {camera.intervals.front(), camera.intervals.back(), {1, 1000000}};
    return 0;
  }
  if (query.index >= camera.intervals.size()) return EINVAL;
  query.type = V4L2_FRMIVAL_TYPE_DISCRETE;
  query.discrete = camera.intervals[query.index];
  return 0;
}

std::size_t bytes_per_pixel(std::uint32_t fourcc) {
  switch (fourcc) {
    case V4L2_PIX_FMT_GREY:
    case V4L2_PIX_FMT_SRGGB8:
      return 1;
    case V4L2_PIX_FMT_RGB24:
      return 3;
    default:
      return 2;
  }
}

int set_format(FakeCamera& camera, v4l2_format& format) {
  if (camera.streaming) return EBUSY;
  v4l2_pix_format& pixels = format.fmt.pix;
  pixels.field = V4L2_FIELD_NONE;
  pixels.colorspace = V4L2_COLORSPACE_SRGB;
  pixels.xfer_func = pixels.ycbcr_enc = pixels.quantization = 0;
  camera.grant_format(pixels);
  pixels.bytesperline = static_cast<__u32>(pixels.width * bytes_per_pixel(pixels.pixelformat) + camera.row_padding);
  pixels.sizeimage = pixels.bytesperline * pixels.height;
  camera.format = pixels;
  return 0;
}

int query_control(const FakeCamera& camera, v4l2_query_ext_ctrl& query) {
  const bool next = query.id & V4L2_CTRL_FLAG_NEXT_CTRL;
  const std::uint32_t id = query.id & 0x0fffffff;
  const auto found = next ? camera.controls.upper_bound(id) : camera.controls.find(id);
  if (found == camera.controls.end()) return EINVAL;
  const FakeControl& control = found->second;
  query = {};
  query.id = found->first;
  query.type = control.type;
  std::strncpy(query.name, control.name.c_str(), sizeof query.name - 1);
  query.minimum = control.minimum;
  query.maximum = control.maximum;
  query.step = static_cast<__u64>(control.step);
  query.flags = control.flags;
  // As uvcvideo: out of reach while the camera chooses for itself.
  const auto mode = camera.controls.find(V4L2_CID_EXPOSURE_AUTO);
  const bool automatic = mode != camera.controls.end() && mode->second.value != V4L2_EXPOSURE_MANUAL;
  if (found->first == V4L2_CID_EXPOSURE_ABSOLUTE && automatic) query.flags |= V4L2_CTRL_FLAG_INACTIVE;
  return 0;
}

int query_menu(const FakeCamera& camera, v4l2_querymenu& query) {
  const auto control = camera.controls.find(query.id);
  if (control == camera.controls.end()) return EINVAL;
  const auto item = control->second.menu.find(query.index);
  if (item == control->second.menu.end()) return EINVAL;
  std::memset(query.name, 0, sizeof query.name);  // a packed field: no reference to it
  std::memcpy(query.name, item->second.data(), std::min(item->second.size(), sizeof query.name));
  return 0;
}

int set_control(FakeCamera& camera, v4l2_ext_controls& controls) {
  const auto found = camera.controls.find(controls.controls->id);
  if (found == camera.controls.end()) return EINVAL;
  FakeControl& control = found->second;
  if (control.flags & V4L2_CTRL_FLAG_READ_ONLY) return EACCES;
  if (control.flags & V4L2_CTRL_FLAG_GRABBED && camera.streaming) return EBUSY;
  control.value =
      control.grants.value_or(std::clamp<std::int64_t>(controls.controls->value, control.minimum, control.maximum));
  return 0;
}

int get_control(const FakeCamera& camera, v4l2_ext_controls& controls) {
  const auto found = camera.controls.find(controls.controls->id);
  if (found == camera.controls.end()) return EINVAL;
  controls.controls->value = static_cast<__s32>(found->second.value);
  return 0;
}

int parameters(FakeCamera& camera, v4l2_streamparm& query, bool set) {
  if (camera.intervals.empty()) return ENOTTY;
  if (set) {
    if (camera.streaming) return EBUSY;
    camera.interval = query.parm.capture.timeperframe;
    const auto known = [&](v4l2_fract interval) { return same(interval, camera.interval); };
    if (!camera.interval_range && std::none_of(camera.intervals.begin(), camera.intervals.end(), known)) {
      camera.interval = camera.intervals.front();
    }
    if (camera.grant_interval) camera.interval = *camera.grant_interval;
  }
  query.parm.capture.capability = V4L2_CAP_TIMEPERFRAME;
  query.parm.capture.timeperframe = camera.interval;
  return 0;
}

int request_buffers(FakeCamera& camera, v4l2_requestbuffers& request) {
  if (request.memory == V4L2_MEMORY_MMAP && !camera.has_mmap) return EINVAL;
  if (camera.streaming) return EBUSY;
  camera.memory = request.memory;
  camera.queued.clear();
  camera.user.clear();
  camera.mapped.assign(request.memory == V4L2_MEMORY_MMAP ? request.count : 0,
                       std::vector<std::byte>(camera.format.sizeimage));
  return 0;
}

int queue_buffer(FakeCamera& camera, const v4l2_buffer& buffer) {
  if (buffer.memory != camera.memory) return EINVAL;
  if (std::find(camera.queued.begin(), camera.queued.end(), buffer.index) != camera.queued.end()) return EINVAL;
  if (camera.memory == V4L2_MEMORY_USERPTR) {
    if (buffer.length < camera.format.sizeimage || buffer.m.userptr % 4096 != 0) return EFAULT;
    camera.user[buffer.index] = {reinterpret_cast<std::byte*>(buffer.m.userptr), buffer.length};
  }
  // The driver may write into it at once: whoever still reads it sees this.
  const std::span<std::byte> bytes =
      camera.memory == V4L2_MEMORY_USERPTR ? camera.user[buffer.index] : std::span(camera.mapped[buffer.index]);
  std::fill(bytes.begin(), bytes.end(), std::byte{0x5a});
  camera.queued.push_back(buffer.index);
  return 0;
}

int dequeue_buffer(FakeCamera& camera, v4l2_buffer& buffer, core::Nanoseconds now) {
  if (buffer.memory != camera.memory || !camera.streaming) return EINVAL;
  if (camera.frames.empty() || camera.frames.front().ready > now || camera.queued.empty()) return EAGAIN;
  const FakeFrame frame = std::move(camera.frames.front());
  camera.frames.pop_front();
  buffer.index = camera.queued.front();
  camera.queued.pop_front();
  const std::span<std::byte> bytes =
      camera.memory == V4L2_MEMORY_USERPTR ? camera.user[buffer.index] : std::span(camera.mapped[buffer.index]);
  std::copy_n(frame.bytes.begin(), std::min(frame.bytes.size(), bytes.size()), bytes.begin());
  buffer.bytesused = static_cast<__u32>(frame.bytes.size());
  buffer.sequence = frame.sequence;
  buffer.flags = frame.flags;
  buffer.timestamp.tv_sec = frame.timestamp / core::kSecond;
  buffer.timestamp.tv_usec = frame.timestamp % core::kSecond / 1000;
  return 0;
}

int stream(FakeCamera& camera, bool on) {
  if (on) ++camera.stream_starts;
  if (!on) camera.frames.clear();
  if (!on) camera.queued.clear();
  camera.streaming = on;
  return 0;
}

template <class Argument>
Argument& as(void* argument) {
  return *static_cast<Argument*>(argument);
}

}  // namespace

std::vector<capture::VideoNode> FakeVideo::nodes() {
  on_list();
  std::vector<capture::VideoNode> result;
  for (const auto& camera : cameras) {
    if (!camera->gone) result.push_back(camera->node);
  }
  return result;
}

int FakeVideo::open(const std::string& path, int& descriptor) {
  for (const auto& camera : cameras) {
    if (camera->node.path != path || camera->gone) continue;
    if (camera->open_error != 0) return camera->open_error;
    ++camera->opened;
    descriptor = next_descriptor_++;
    descriptors_[descriptor] = camera;
    return 0;
  }
  return ENOENT;
}

void FakeVideo::close(int descriptor) {
  const std::shared_ptr<FakeCamera> camera = descriptors_.at(descriptor);
  descriptors_.erase(descriptor);
}

int FakeVideo::ioctl(int descriptor, unsigned long request, void* argument) {
  FakeCamera& camera = *descriptors_.at(descriptor);
  if (camera.gone) return ENODEV;
  std::deque<int>& errors = camera.errors[request];
  if (!errors.empty()) {
    const int error = errors.front();
    errors.pop_front();
    if (error != 0) return error;
  }
  switch (request) {
    case VIDIOC_QUERYCAP:
      return query_capability(camera, as<v4l2_capability>(argument));
    case VIDIOC_ENUM_FMT:
      return enumerate_format(camera, as<v4l2_fmtdesc>(argument));
    case VIDIOC_ENUM_FRAMESIZES:
      return enumerate_size(camera, as<v4l2_frmsizeenum>(argument));
    case VIDIOC_ENUM_FRAMEINTERVALS:
      return enumerate_interval(camera, as<v4l2_frmivalenum>(argument));
    case VIDIOC_S_FMT:
      return set_format(camera, as<v4l2_format>(argument));
    case VIDIOC_QUERY_EXT_CTRL:
      return query_control(camera, as<v4l2_query_ext_ctrl>(argument));
    case VIDIOC_QUERYMENU:
      return query_menu(camera, as<v4l2_querymenu>(argument));
    case VIDIOC_S_EXT_CTRLS:
      return set_control(camera, as<v4l2_ext_controls>(argument));
    case VIDIOC_G_EXT_CTRLS:
      return get_control(camera, as<v4l2_ext_controls>(argument));
    case VIDIOC_G_PARM:
      return parameters(camera, as<v4l2_streamparm>(argument), false);
    case VIDIOC_S_PARM:
      return parameters(camera, as<v4l2_streamparm>(argument), true);
    case VIDIOC_REQBUFS:
      return request_buffers(camera, as<v4l2_requestbuffers>(argument));
    case VIDIOC_QUERYBUF: {
      auto& buffer = as<v4l2_buffer>(argument);
      buffer.length = camera.format.sizeimage;
      buffer.m.offset = buffer.index;
      return 0;
    }
    case VIDIOC_QBUF:
      return queue_buffer(camera, as<v4l2_buffer>(argument));
    case VIDIOC_DQBUF:
      return dequeue_buffer(camera, as<v4l2_buffer>(argument), clock_.now());
    case VIDIOC_STREAMON:
      return stream(camera, true);
    case VIDIOC_STREAMOFF:
      return stream(camera, false);
    default:
      return ENOTTY;
  }
}

int FakeVideo::poll(int descriptor, core::Nanoseconds timeout, short& events) {
  FakeCamera& camera = *descriptors_.at(descriptor);
  events = camera.poll_events;
  if (camera.gone) events = POLLERR | POLLHUP;
  if (events != 0) return 0;
  const core::Nanoseconds deadline = clock_.now() + std::max<core::Nanoseconds>(timeout, 0);
  if (camera.frames.empty() || camera.frames.front().ready > deadline) {
    clock_.sleep_until(deadline);
    return 0;
  }
  clock_.sleep_until(camera.frames.front().ready);
  events = POLLIN;
  return 0;
}

int FakeVideo::map(int descriptor, std::size_t length, std::int64_t offset, std::byte*& address) {
  FakeCamera& camera = *descriptors_.at(descriptor);
  std::vector<std::byte>& buffer = camera.mapped.at(static_cast<std::size_t>(offset));
  if (length != buffer.size()) return EINVAL;
  address = buffer.data();
  ++mappings_;
  return 0;
}

void FakeVideo::unmap(std::byte*, std::size_t) {
  --mappings_;
}

std::shared_ptr<FakeCamera> uvc_camera(const std::string& path, const std::string& serial,
                                       const std::string& bus_path) {
  auto camera = std::make_shared<FakeCamera>();
  camera->node = {path, "Fake camera", serial, 0};
  camera->bus_path = bus_path;
  camera->formats = {V4L2_PIX_FMT_YUYV, V4L2_PIX_FMT_MJPEG, V4L2_PIX_FMT_Y16, V4L2_PIX_FMT_GREY};
  camera->sizes = {{640, 480}, {8, 6}};
  camera->intervals = {{1, 30}, {1, 10}, {1, 60}};
  camera->controls = {
      {V4L2_CID_AUTO_WHITE_BALANCE, {"White Balance, Automatic", V4L2_CTRL_TYPE_BOOLEAN, 0, 1, 1, 1}},
      {V4L2_CID_GAIN, {"Gain", V4L2_CTRL_TYPE_INTEGER, 0, 100, 1, 50}},
      {V4L2_CID_EXPOSURE_AUTO, {"Auto Exposure", V4L2_CTRL_TYPE_MENU, 0, 3, 1, 3}},
      {V4L2_CID_EXPOSURE_ABSOLUTE, {"Exposure Time, Absolute", V4L2_CTRL_TYPE_INTEGER, 1, 5000, 1, 100}},
      {V4L2_CID_EXPOSURE_AUTO_PRIORITY, {"Exposure, Dynamic Framerate", V4L2_CTRL_TYPE_BOOLEAN, 0, 1, 1, 1}},
      {V4L2_CID_FOCUS_AUTO, {"Focus, Automatic Continuous", V4L2_CTRL_TYPE_BOOLEAN, 0, 1, 1, 1}},
  };
  return camera;
}

std::vector<std::byte> flat_picture(int width, int height, int bytes_per_value, int value, std::size_t row_padding) {
  std::vector<std::byte> bytes;
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      for (int b = 0; b < bytes_per_value; ++b) bytes.push_back(static_cast<std::byte>(value >> (8 * b)));
    }
    bytes.insert(bytes.end(), row_padding, std::byte{0xee});
  }
  return bytes;
}

}  // namespace lightstage::test
