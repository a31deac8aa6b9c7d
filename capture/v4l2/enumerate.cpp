#include "capture/v4l2/enumerate.h"

#include <algorithm>
#include <cstring>
#include <set>

#include "capture/v4l2/controls.h"
#include "capture/v4l2/frame_interval.h"
#include "capture/v4l2/pixel_format.h"
#include "capture/v4l2/trigger_control.h"
#include "capture/v4l2/video_device.h"

namespace lightstage::capture {

namespace {

// No driver lists more; one that never ends does no harm.
constexpr __u32 kMaxEntries = 1000;

std::vector<v4l2_fmtdesc> format_descriptions(const VideoDevice& device) {
  std::vector<v4l2_fmtdesc> formats;
  for (__u32 i = 0; i < kMaxEntries; ++i) {
    v4l2_fmtdesc query{};
    query.type = V4L2_BUF_TYPE_VIDEO_CAPTURE;
    query.index = i;
    if (device.try_call(VIDIOC_ENUM_FMT, query)) break;
    formats.push_back(query);
  }
  return formats;
}

V4l2Size size_of(const v4l2_frmsizeenum& query) {
  V4l2Size size;
  const auto pixels = [](__u32 v) { return static_cast<int>(v); };
  if (query.type == V4L2_FRMSIZE_TYPE_DISCRETE) {
    size.width = size.largest_width = pixels(query.discrete.width);
    size.height = size.largest_height = pixels(query.discrete.height);
    return size;
  }
  const v4l2_frmsize_stepwise& range = query.stepwise;
  size.width = pixels(range.min_width);
  size.height = pixels(range.min_height);
  size.largest_width = pixels(range.max_width);
  size.largest_height = pixels(range.max_height);
  size.width_step = std::max(1, pixels(range.step_width));
  size.height_step = std::max(1, pixels(range.step_height));
  return size;
}

std::vector<V4l2Size> sizes(const VideoDevice& device, __u32 fourcc) {
  std::vector<V4l2Size> result;
  for (__u32 i = 0; i < kMaxEntries; ++i) {
    v4l2_frmsizeenum query{};
    query.index = i;
    query.pixel_format = fourcc;
    if (device.try_call(VIDIOC_ENUM_FRAMESIZES, query)) break;
    V4l2Size size = size_of(query);
    const FrameIntervals intervals = frame_intervals(device, fourcc, size.width, size.height);
    size.any_rate_between = intervals.is_range;
    for (const v4l2_fract interval : intervals.intervals) {
      size.rates.push_back(static_cast<double>(interval.denominator) / interval.numerator);
    }
    result.push_back(std::move(size));
    if (query.type != V4L2_FRMSIZE_TYPE_DISCRETE) break;  // the one entry is the whole range
  }
  return result;
}

V4l2CameraSeen look_at(const VideoDevice& device, const VideoNode& node) {
  V4l2CameraSeen camera{node.path, device.card(), device.driver(), device.bus_path(), node.serial, {}};
  for (const v4l2_fmtdesc& format : format_descriptions(device)) {
    const auto* const text = reinterpret_cast<const char*>(format.description);
    camera.formats.push_back({fourcc_text(format.pixelformat),
                              std::string(text, strnlen(text, sizeof format.description)), refusal(format.pixelformat),
                              sizes(device, format.pixelformat)});
  }
  const std::optional<Control> exposure = find_control(device, V4L2_CID_EXPOSURE_ABSOLUTE);
  camera.has_exposure = exposure.has_value();
  camera.has_trigger = find_trigger_control(device).has_value();
  const bool usable = std::any_of(camera.formats.begin(), camera.formats.end(),
                                  [](const V4l2Format& format) { return format.refused.empty(); });
  if (!usable) {
    camera.problem = "it offers no format that can be measured in; use another camera";
  } else if (!camera.has_exposure) {
    camera.problem = "its driver offers no exposure in units of time; use another camera or driver";
  }
  return camera;
}

bool offers(const VideoDevice& device, std::uint32_t fourcc) {
  const std::vector<v4l2_fmtdesc> formats = format_descriptions(device);
  return std::any_of(formats.begin(), formats.end(),
                     [fourcc](const v4l2_fmtdesc& format) { return format.pixelformat == fourcc; });
}

struct Candidate {
  std::string node, bus_path;
  bool has_format = false;
};

}  // namespace

std::vector<V4l2CameraSeen> cameras_seen(VideoSystem& system) {
  std::vector<V4l2CameraSeen> cameras;
  for (const VideoNode& node : system.nodes()) {
    try {
      const VideoDevice device(system, node.path, "");
      if (device.captures()) cameras.push_back(look_at(device, node));
    } catch (const VideoError& error) {
      // Whether it delivers pictures cannot be asked; a camera's first node does.
      if (node.index == 0)
        cameras.push_back({node.path, node.card, "", "", node.serial, {}, false, false, error.what()});
    }
  }
  return cameras;
}

std::string find_camera_node(VideoSystem& system, const std::string& match, std::uint32_t fourcc,
                             const std::string& user) {
  if (match.starts_with('/')) return match;
  std::vector<Candidate> candidates;
  std::string present;
  for (const VideoNode& node : system.nodes()) {
    const auto note = [&](const std::string& card, const std::string& about) {
      const std::string serial = node.serial.empty() ? "" : ", serial number " + node.serial;
      present += (present.empty() ? "" : "; ") + node.path + ": " + card + serial + about;
    };
    try {
      const VideoDevice device(system, node.path, user);
      if (!device.captures()) continue;
      if (match == node.serial || match == device.bus_path()) {
        candidates.push_back({node.path, device.bus_path(), offers(device, fourcc)});
      }
      note(device.card(), ", bus path " + device.bus_path());
    } catch (const VideoError& error) {
      if (node.index != 0) continue;
      if (match == node.serial) throw;
      note(node.card, std::string(" (") + error.what() + ")");
    }
  }
  if (candidates.empty()) {
    throw core::DeviceError(user + ": no camera has the serial number or bus path '" + match +
                            "'; plug it in, or correct " +
                            "`match` in the stage file. There are: " + (present.empty() ? "none" : present));
  }
  for (const Candidate& candidate : candidates) {
    if (candidate.bus_path == candidates.front().bus_path) continue;
    throw core::DeviceError(user + ": two cameras have the serial number '" + match +
                            "'; write a bus path into the stage " + "file instead: " + candidates.front().bus_path +
                            " or " + candidate.bus_path);
  }
  const auto with_format =
      std::find_if(candidates.begin(), candidates.end(), [](const Candidate& c) { return c.has_format; });
  return (with_format == candidates.end() ? candidates.front() : *with_format).node;
}

std::vector<V4l2CameraSeen> v4l2_cameras_seen() {
  return cameras_seen(kernel_video_system());
}

}  // namespace lightstage::capture
