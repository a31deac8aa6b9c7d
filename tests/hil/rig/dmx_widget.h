// An emulated shop-bought DMX dimmer interface: an FTDI serial chip behind which an Enttec DMX USB Pro listens (messages
// 0x7E, label, length, data, 0xE7; "DMX USB Pro Widget API Specification 1.44").
#pragma once

#include <functional>
#include <optional>

#include "hil/rig/scene.h"
#include "hil/rig/usbip_device.h"

namespace lightstage::hil {

// Its first kDmxChannels channels light cells of the scene. As real ones do it goes on sending the last values it was given until it
// is unplugged, whatever becomes of the host.
class DmxWidget : public UsbipDevice {
 public:
  // The serial number is DMX0.
  DmxWidget(int port, Scene& scene);

  // Called for every set of channel values.
  std::function<void()> on_values;

  std::optional<Nanoseconds> next_event() const;
  void advance(Nanoseconds time);

 protected:
  Bytes configuration() const override;
  std::optional<Bytes> control_in(const Setup& setup) override;
  bool control_out(const Setup& setup, ByteView data) override;
  bool bulk_out(std::uint8_t endpoint, ByteView data) override;
  void bulk_in_waiting(std::uint8_t endpoint) override;
  void unplugged() override;

 private:
  void take_messages();
  void handle(std::uint8_t label, ByteView data);
  void reply(std::uint8_t label, ByteView data);
  void show(ByteView values);
  void send(bool even_empty);

  Scene& scene_;
  Bytes received_, to_send_;
  Nanoseconds answer_due_ = 0;  // when the chip answers even without data
};

}  // namespace lightstage::hil
