// A USB device emulated from user space: a USB/IP server whose client is the kernel's virtual host controller (vhci-hcd).
// What the kernel's drivers and libusb see is a device on a root hub.
//
// Protocol: Documentation/usb/usbip_protocol.rst of the kernel, and the USB 2.0 specification, chapter 9.
#pragma once

#include <deque>
#include <map>
#include <optional>
#include <string>

#include "hil/rig/bytes.h"
#include "hil/rig/file_descriptor.h"

namespace lightstage::hil {

// The eight bytes that begin a control transfer.
struct Setup {
  std::uint8_t request_type = 0, request = 0;
  std::uint16_t value = 0, index = 0, length = 0;
  bool in() const { return (request_type & 0x80) != 0; }
  bool standard() const { return (request_type & 0x60) == 0; }
};

struct UsbIdentity {
  std::uint16_t vendor = 0, product = 0;
  std::uint8_t device_class = 0, device_subclass = 0, device_protocol = 0;
  std::string manufacturer, product_name, serial;
  bool full_speed = false;  // else high speed
};

class UsbipDevice {
 public:
  // `port` is one of the eight high-speed ports of vhci_hcd.0. Not plugged in yet.
  UsbipDevice(int port, UsbIdentity identity) : port_(port), identity_(std::move(identity)) {}
  virtual ~UsbipDevice() = default;
  UsbipDevice(const UsbipDevice&) = delete;
  UsbipDevice& operator=(const UsbipDevice&) = delete;

  bool plugged() const { return static_cast<bool>(link_); }
  // False while the port is still busy with the device that was unplugged from it: try again a little later. Throws when the
  // kernel refuses for another reason.
  bool plug();
  // All transfers under way end in ENODEV.
  void unplug();

  // For poll(); -1 while unplugged.
  int fd() const { return link_.get(); }
  // Answers what the kernel asks; call when fd() can be read.
  void serve();

 protected:
  virtual Bytes configuration() const = 0;
  // Class and vendor requests: the answer to one that reads; whether one that writes is accepted. Refused ones stall.
  virtual std::optional<Bytes> control_in(const Setup&) { return std::nullopt; }
  virtual bool control_out(const Setup&, ByteView) { return false; }
  // Data that the host sent; it is acknowledged when this returns true, and stalls otherwise.
  virtual bool bulk_out(std::uint8_t endpoint, ByteView data) = 0;
  // The host waits for data of this endpoint.
  virtual void bulk_in_waiting(std::uint8_t endpoint) = 0;
  virtual void endpoint_cleared(std::uint8_t) {}
  virtual void unplugged() {}

  // Size of the oldest transfer that waits for this endpoint's data; nothing when none does.
  std::optional<std::size_t> waiting(std::uint8_t endpoint) const;
  // Ends that transfer with this data.
  void answer(std::uint8_t endpoint, ByteView data);

 private:
  struct Transfer {
    std::uint32_t number = 0;
    std::size_t size = 0;
  };

  Bytes device_descriptor() const;
  std::optional<Bytes> string_descriptor(std::uint8_t index) const;
  std::optional<Bytes> descriptor(std::uint16_t value) const;
  void control(std::uint32_t number, std::size_t size, const Setup& setup, ByteView data);
  std::optional<Bytes> standard_in(const Setup& setup) const;
  bool standard_out(const Setup& setup);
  void unlink(std::uint32_t number, std::uint32_t victim);
  void submitted(std::uint32_t number, std::int32_t status, std::size_t size, ByteView data = {});
  void reply(std::uint32_t command, std::uint32_t number, std::int32_t status, std::size_t size, ByteView data);
  bool receive(std::span<std::uint8_t> bytes);

  int port_;
  UsbIdentity identity_;
  FileDescriptor link_;
  std::map<std::uint8_t, std::deque<Transfer>> waiting_;  // by endpoint number, those that read
};

}  // namespace lightstage::hil
