#include "capture/devices_seen.h"

#include <fstream>
#include <set>

namespace lightstage::capture {

namespace {

namespace fs = std::filesystem;

constexpr const char* kVideoClass = "0e";
constexpr const char *kCp2112Vendor = "10c4", *kCp2112Product = "ea90";

std::string attribute(const fs::path& device, const char* name) {
  std::ifstream file(device / name);
  std::string value;
  std::getline(file, value);
  return value;
}

// The driver of a CP2112 binds to the HID device below its interface, and makes a GPIO chip there.
bool has_gpio_chip(const fs::path& usb_device) {
  std::error_code unreadable;
  for (auto entry = fs::recursive_directory_iterator(usb_device, unreadable);
       !unreadable && entry != fs::recursive_directory_iterator(); entry.increment(unreadable)) {
    if (entry->path().filename().string().starts_with("gpiochip")) return true;
  }
  return false;
}

}  // namespace

DevicesSeen devices_seen() {
  return {.controllers = usb_leds_seen(),
          .cameras = v4l2_cameras_seen(),
          .gpio_chips = gpio_chips_seen(),
          .missing_modules = missing_modules("/sys")};
}

std::vector<std::string> missing_modules(const fs::path& sysfs) {
  std::set<std::string> missing;
  std::error_code no_usb;
  for (const fs::directory_entry& entry : fs::directory_iterator(sysfs / "bus/usb/devices", no_usb)) {
    const fs::path& device = entry.path();
    if (attribute(device, "bInterfaceClass") == kVideoClass && !fs::exists(device / "driver")) {
      missing.insert("uvcvideo");
    }
    if (attribute(device, "idVendor") == kCp2112Vendor && attribute(device, "idProduct") == kCp2112Product &&
        !has_gpio_chip(device)) {
      missing.insert("hid_cp2112");
    }
  }
  return {missing.begin(), missing.end()};
}

std::vector<std::string> device_problems(const DevicesSeen& seen) {
  std::vector<std::string> problems;
  for (const UsbLedsSeen& controller : seen.controllers) {
    // What may be any serial adapter is nobody's problem.
    if (controller.certain && !controller.accessible) {
      problems.push_back("LED controller " + controller.serial + " at " + controller.bus_path + ": " +
                         controller.advice);
    }
  }
  for (const V4l2CameraSeen& camera : seen.cameras) {
    if (camera.problem.empty()) continue;
    // What failed to open names its node already.
    problems.push_back("camera " + (camera.problem.starts_with(camera.node) ? "" : camera.node + ": ") +
                       camera.problem);
  }
  for (const GpioChipSeen& chip : seen.gpio_chips) {
    if (!chip.problem.empty()) problems.push_back("GPIO chip " + chip.path + ": " + chip.problem);
  }
  for (const std::string& module : seen.missing_modules) {
    problems.push_back("a device that needs the kernel module " + module +
                       " is plugged in, but not driven: sudo modprobe " + module);
  }
  return problems;
}

}  // namespace lightstage::capture
