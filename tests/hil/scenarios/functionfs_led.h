// An LED controller made with the kernel's own means for USB devices (FunctionFS on dummy_hcd). Another host controller driver than
// USB/IP's: after an unplug transfers fail in another way (libusb says IO before it says NO_DEVICE).
#pragma once

#include <atomic>
#include <memory>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

#include "core/clock.h"
#include "sim/led_firmware.h"

namespace lightstage::hil {

class FunctionFsLed {
 public:
  // Plugged in. Throws std::runtime_error where the kernel refuses. One at a time.
  explicit FunctionFsLed(const std::string& serial);
  ~FunctionFsLed();
  FunctionFsLed(const FunctionFsLed&) = delete;
  FunctionFsLed& operator=(const FunctionFsLed&) = delete;

  void plug();
  void unplug();

  // Outputs that are on.
  std::vector<int> lit() const;

 private:
  void serve();

  core::SystemClock clock_;
  core::Nanoseconds power_on_;
  mutable std::mutex mutex_;  // of the firmware
  sim::LedFirmware firmware_;
  int control_ = -1, in_ = -1, out_ = -1;  // endpoints
  bool plugged_ = false;
  std::atomic<bool> stop_ = false;
  std::thread server_;
};

}  // namespace lightstage::hil
