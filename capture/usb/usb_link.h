// A USB device as a stream that comes back after it was unplugged. Room-internal.
#pragma once

#include <functional>
#include <memory>
#include <string>

#include "capture/led_link.h"
#include "capture/usb/usb_device.h"

namespace lightstage::capture {

// Opened by the first use. After any error the device is closed, and the next use opens the same serial number again; it waits
// for it until 3 s after the error.
class UsbLink : public LedLink {
 public:
  using OnOpen = std::function<void(UsbDevice&)>;
  UsbLink(ControllerKind kind, std::string serial, core::Clock& clock, OnOpen on_open = {});

  void write(std::span<const std::uint8_t> bytes, core::Nanoseconds deadline) override;
  std::vector<std::uint8_t> read(core::Nanoseconds deadline) override;
  // Of the device that is open, or was last.
  const std::string& serial() const { return serial_; }
  std::size_t packet_bytes() const { return packet_bytes_; }

 private:
  UsbDevice& device();
  template <class Action>
  auto attempt(const Action& action);
  int milliseconds_until(core::Nanoseconds deadline) const;

  ControllerKind kind_;
  std::string serial_;
  core::Clock& clock_;
  OnOpen on_open_;
  std::unique_ptr<UsbDevice> device_;
  std::size_t packet_bytes_ = 64;
  core::Nanoseconds wait_until_ = 0;  // for a device that was there to come back
};

}  // namespace lightstage::capture
