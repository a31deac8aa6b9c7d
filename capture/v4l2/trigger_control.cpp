#include "capture/v4l2/trigger_control.h"

#include <algorithm>
#include <array>

namespace lightstage::capture {

namespace {

using Words = std::vector<std::string_view>;
const Words kNames = {"triggermode", "externaltrigger", "hardwaretrigger", "triggerenable"};
const Words kOn = {"on", "enabled", "external", "externaltrigger", "hardware", "hardwaretrigger", "slave", "triggered"};
const Words kOff = {"off", "disabled", "freerun", "freerunning", "internal", "none", "continuous"};

// "Trigger Mode", "trigger_mode" and "TriggerMode" are one.
std::string letters(const std::string& text) {
  std::string result;
  for (const char c : text) {
    if (c >= 'a' && c <= 'z') result += c;
    if (c >= 'A' && c <= 'Z') result += static_cast<char>(c - 'A' + 'a');
  }
  return result;
}

bool is_one_of(const Words& words, const std::string& text) {
  return std::find(words.begin(), words.end(), letters(text)) != words.end();
}

std::optional<TriggerControl> from_menu(const VideoDevice& device, const Control& control) {
  std::optional<std::int64_t> on, off;
  for (const MenuItem& item : menu_items(device, control)) {
    if (!on && is_one_of(kOn, item.name)) on = item.value;
    if (!off && is_one_of(kOff, item.name)) off = item.value;
  }
  if (!on || !off) return std::nullopt;
  return TriggerControl{control, *on, *off};
}

}  // namespace

std::optional<TriggerControl> find_trigger_control(const VideoDevice& device) {
  for (const Control& control : list_controls(device)) {
    if (!is_one_of(kNames, control.name) || !control.writable()) continue;
    if (control.type == V4L2_CTRL_TYPE_MENU) {
      if (const std::optional<TriggerControl> trigger = from_menu(device, control)) return trigger;
    } else if (control.minimum == 0 && control.maximum >= 1) {
      return TriggerControl{control, 1, 0};
    }
  }
  return std::nullopt;
}

}  // namespace lightstage::capture
