// One USB device that is an LED controller, opened by libusb. Room-internal.
#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "capture/hardware.h"
#include "capture/usb_leds.h"

struct libusb_device_handle;

namespace lightstage::capture {

// What is plugged in, by the bus's own tables and without opening anything where sysfs has the names. Empty where the
// machine has no USB.
std::vector<UsbLedsSeen> find_usb_leds();

// Every function throws DeviceError naming the device; after that the object is of no more use. Times are real ones.
class UsbDevice {
 public:
  // The device of this kind and serial number (empty: the only one of its kind), with its kernel driver detached until it is
  // closed. Sees what is plugged in at the moment, also where no udev tells of changes. Throws DeviceError when there is none
  // or more than one, when it is not permitted (with what to do), or in use by another program.
  UsbDevice(ControllerKind kind, const std::string& serial);
  ~UsbDevice();
  UsbDevice(const UsbDevice&) = delete;
  UsbDevice& operator=(const UsbDevice&) = delete;

  const std::string& serial() const { return serial_; }
  std::size_t packet_bytes() const { return packet_bytes_; }  // of the IN endpoint

  // A stalled pipe is freed and tried once more. When time is up, what has been sent was sent.
  void write(std::span<const std::uint8_t> bytes, int timeout_ms);
  std::vector<std::uint8_t> read(int timeout_ms);
  // A vendor's request without data. A device that does not know it stalls, which is not an error.
  void vendor_request(std::uint8_t request, std::uint16_t value);

 private:
  struct Context;
  struct Closer {
    void operator()(libusb_device_handle* handle) const;
  };
  [[noreturn]] void fail(const std::string& doing, int code) const;

  std::unique_ptr<Context> context_;
  std::unique_ptr<libusb_device_handle, Closer> handle_;  // closed before its context
  std::string serial_, name_;
  int interface_ = 0;
  std::uint8_t in_ = 0, out_ = 0;
  std::size_t packet_bytes_ = 64;
};

}  // namespace lightstage::capture
