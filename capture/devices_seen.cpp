#include "capture/devices_seen.h"

#include <unistd.h>

#include <filesystem>

namespace lightstage::capture {

namespace fs = std::filesystem;

std::vector<DeviceSeen> devices_seen() {
  std::vector<DeviceSeen> devices;
  std::error_code no_folder;
  for (const fs::directory_entry& entry : fs::directory_iterator("/dev", no_folder)) {
    const std::string name = entry.path().filename().string();
    const std::string kind = name.starts_with("video") ? "camera" : name.starts_with("gpiochip") ? "gpio" : "";
    if (kind.empty()) continue;
    devices.push_back({kind, entry.path().string(), access(entry.path().c_str(), R_OK | W_OK) == 0});
  }
  std::sort(devices.begin(), devices.end(), [](const DeviceSeen& a, const DeviceSeen& b) { return a.path < b.path; });
  return devices;
}

}  // namespace lightstage::capture
