// Which devices of a stage this machine has, and whether a stage can be run with them.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "capture/gpio_lines.h"
#include "capture/stage.h"
#include "capture/usb_leds.h"
#include "capture/v4l2_cameras.h"

namespace lightstage::capture {

struct DevicesSeen {
  std::vector<UsbLedsSeen> controllers;
  std::vector<V4l2CameraSeen> cameras;
  std::vector<GpioChipSeen> gpio_chips;
  std::vector<std::string> missing_modules;  // kernel modules that devices which are plugged in wait for
};

// Looks at every device without switching anything.
DevicesSeen devices_seen();

// Modules that USB devices without a driver want: "uvcvideo" for cameras, "hid_cp2112" for that GPIO bridge. `sysfs` is /sys.
std::vector<std::string> missing_modules(const std::filesystem::path& sysfs);

// What is wrong with the devices themselves, and how to mend it: one line each.
std::vector<std::string> device_problems(const DevicesSeen& seen);

// What keeps `stage` from running with these devices, and what to change: one line each, beginning with the part of the stage
// file that it is about. Problems of the devices that it uses are among them.
std::vector<std::string> stage_problems(const Stage& stage, const DevicesSeen& seen);

}  // namespace lightstage::capture
