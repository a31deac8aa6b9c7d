// An emulated LED controller: the USB interface of docs/led-protocol.md around the same firmware that serves the simulated stage.
#pragma once

#include <functional>
#include <memory>
#include <optional>

#include "hil/rig/scene.h"
#include "hil/rig/usbip_device.h"
#include "sim/led_firmware.h"

namespace lightstage::hil {

// Its outputs light the first kLedOutputs cells of the scene. It has a supply of its own: unplugged it does not forget.
class LedDevice : public UsbipDevice {
 public:
  // The serial number is LED<port>.
  LedDevice(int port, Scene& scene);

  // Called for each transfer of the host, before it is looked at.
  std::function<void()> on_request;

  // The next transfers of the host vanish unheard, or stall.
  void mute(int transfers) { mute_ = transfers; }
  void stall(int transfers) { stall_ = transfers; }

  // Its power goes and comes: it is dark, cool, and knows nothing.
  void power_cycle();

  void strobe(bool rising, Nanoseconds time);
  std::optional<Nanoseconds> next_event() const;
  void advance(Nanoseconds time);

 protected:
  Bytes configuration() const override;
  bool bulk_out(std::uint8_t endpoint, ByteView data) override;
  void bulk_in_waiting(std::uint8_t) override { send(); }
  void unplugged() override;

 private:
  Nanoseconds since_power_on(Nanoseconds time) const { return time - power_on_; }
  void send();

  int port_;
  Scene& scene_;
  Nanoseconds power_on_ = 0;
  std::optional<sim::LedFirmware> firmware_;  // always there
  Bytes to_send_;
  int mute_ = 0, stall_ = 0;
};

}  // namespace lightstage::hil
