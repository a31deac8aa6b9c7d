#include "capture/v4l2/controls.h"

#include <algorithm>
#include <cstring>

namespace lightstage::capture {

namespace {

Control from_query(const v4l2_query_ext_ctrl& query) {
  Control control;
  control.id = query.id;
  control.name.assign(query.name, strnlen(query.name, sizeof query.name));
  control.type = query.type;
  control.minimum = query.minimum;
  control.maximum = query.maximum;
  control.step = std::max<std::int64_t>(1, static_cast<std::int64_t>(query.step));
  control.flags = query.flags;
  return control;
}

v4l2_ext_controls just(v4l2_ext_control& control) {
  v4l2_ext_controls controls{};
  controls.which = V4L2_CTRL_WHICH_CUR_VAL;
  controls.count = 1;
  controls.controls = &control;
  return controls;
}

}  // namespace

bool Control::writable() const {
  return !(flags & (V4L2_CTRL_FLAG_DISABLED | V4L2_CTRL_FLAG_READ_ONLY | V4L2_CTRL_FLAG_INACTIVE));
}

std::optional<Control> find_control(const VideoDevice& device, std::uint32_t id) {
  v4l2_query_ext_ctrl query{};
  query.id = id;
  if (device.try_call(VIDIOC_QUERY_EXT_CTRL, query) || (query.flags & V4L2_CTRL_FLAG_DISABLED)) return std::nullopt;
  return from_query(query);
}

std::vector<Control> list_controls(const VideoDevice& device) {
  std::vector<Control> controls;
  v4l2_query_ext_ctrl query{};
  for (std::uint32_t last = 0;; last = query.id) {
    query = {};
    query.id = last | V4L2_CTRL_FLAG_NEXT_CTRL;
    if (device.try_call(VIDIOC_QUERY_EXT_CTRL, query) || query.id <= last) return controls;
    if (query.type != V4L2_CTRL_TYPE_CTRL_CLASS) controls.push_back(from_query(query));
  }
}

std::vector<MenuItem> menu_items(const VideoDevice& device, const Control& control) {
  std::vector<MenuItem> items;
  if (control.type != V4L2_CTRL_TYPE_MENU) return items;
  for (std::int64_t value = control.minimum; value <= control.maximum; ++value) {
    v4l2_querymenu query{};
    query.id = control.id;
    query.index = static_cast<__u32>(value);
    // Menus may have holes.
    if (device.try_call(VIDIOC_QUERYMENU, query)) continue;
    const auto* const name = reinterpret_cast<const char*>(query.name);
    items.push_back({value, std::string(name, strnlen(name, sizeof query.name))});
  }
  return items;
}

std::int64_t control_value(const VideoDevice& device, const Control& control) {
  v4l2_ext_control one{};
  one.id = control.id;
  v4l2_ext_controls controls = just(one);
  device.call(VIDIOC_G_EXT_CTRLS, controls, "read its control '" + control.name + "'");
  return control.type == V4L2_CTRL_TYPE_INTEGER64 ? one.value64 : one.value;
}

void set_control(const VideoDevice& device, const Control& control, std::int64_t value) {
  v4l2_ext_control one{};
  one.id = control.id;
  if (control.type == V4L2_CTRL_TYPE_INTEGER64) {
    one.value64 = value;
  } else {
    one.value = static_cast<__s32>(value);
  }
  v4l2_ext_controls controls = just(one);
  device.call(VIDIOC_S_EXT_CTRLS, controls, "set its control '" + control.name + "' to " + std::to_string(value));
  // Buttons and their like have no value.
  if (control.flags & (V4L2_CTRL_FLAG_WRITE_ONLY | V4L2_CTRL_FLAG_EXECUTE_ON_WRITE)) return;
  const std::int64_t granted = control_value(device, control);
  if (granted != value) {
    device.refuse("its control '" + control.name + "' was set to " + std::to_string(value) + " but stands at " +
                  std::to_string(granted) + " (it goes from " + std::to_string(control.minimum) + " to " +
                  std::to_string(control.maximum) + " in steps of " + std::to_string(control.step) + ")");
  }
}

}  // namespace lightstage::capture
