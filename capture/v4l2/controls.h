// A camera's controls: numbers and choices that the driver offers by number and name.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "capture/v4l2/video_device.h"

namespace lightstage::capture {

struct Control {
  std::uint32_t id = 0;
  std::string name;
  std::uint32_t type = 0;  // v4l2_ctrl_type
  std::int64_t minimum = 0, maximum = 0, step = 1;
  std::uint32_t flags = 0;

  bool writable() const;
};

// Nothing where the device does not have it. Asked anew each time: some controls can be written only while others are off.
std::optional<Control> find_control(const VideoDevice& device, std::uint32_t id);
std::vector<Control> list_controls(const VideoDevice& device);

struct MenuItem {
  std::int64_t value = 0;
  std::string name;
};
// Of a menu; empty for other types.
std::vector<MenuItem> menu_items(const VideoDevice& device, const Control& control);

std::int64_t control_value(const VideoDevice& device, const Control& control);

// Sets it and reads it back. Throws VideoError when the driver refuses, DeviceError naming both values when it grants
// another (drivers clamp without a word). Those that only start something are not read back.
void set_control(const VideoDevice& device, const Control& control, std::int64_t value);

}  // namespace lightstage::capture
