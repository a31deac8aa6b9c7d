// LED controllers on USB: those that speak the project's own protocol (docs/led-protocol.md), and DMX512 widgets that speak the
// Enttec DMX USB Pro's messages.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "capture/devices.h"
#include "capture/hardware.h"
#include "core/clock.h"

namespace lightstage::capture {

// All of these open the device with this USB serial number (empty: the only one of its kind that is plugged in). A device
// that is unplugged is opened again by the next call once it is back, which is waited for up to 3 s after the unplug.
// `clock` must run with real time, and outlive what is returned. All throw DeviceError saying what to do.

// A thread keeps the controller's lights on while the process lives; 500 ms after its end they go out. The controller's output,
// from 0, for each light. The result is a ProtocolLeds (capture/protocol_leds.h).
std::unique_ptr<LedController> open_usb_leds(const std::string& serial, std::vector<int> output_of_light,
                                             core::Clock& clock);

// Channels from 1 to 512 for each light: three for red, green and blue, or one, which gives their mean. Levels are rounded to 8
// bits: steps of 0.4 % of full, so dark levels are coarse. show() returns when the dimmers have got the pattern: after two
// DMX frames of 88 us break + 8 us mark + 44 us for the start code and every channel up to the highest used (at least 24, at
// most 46 ms in all), or two periods of the rate the widget is set to, if that is longer (40 a second as sold: 50 ms).
//
// A widget sends its last pattern for ever, also when the program was killed: then a guard process runs
// `lights_off_command` (a program by its path, and its arguments; none where empty), which must call usb_lights_off.
std::unique_ptr<LedController> open_dmx_widget(const std::string& serial,
                                               std::vector<std::vector<int>> channels_of_light, core::Clock& clock,
                                               const std::vector<std::string>& lights_off_command = {});

// Opens the controller and turns everything off, all 512 channels of a widget.
void usb_lights_off(ControllerKind kind, const std::string& serial, core::Clock& clock);

struct UsbLedsSeen {
  ControllerKind kind = ControllerKind::kLightstage;
  // Of kEnttecDmxUsbPro: only that its FTDI chip could be a widget's; many serial adapters have the same, and only the
  // product's name tells.
  bool certain = true;
  std::string product, serial;  // as the device calls itself; empty where it does not
  std::string vendor_product;   // "1209:0001"
  std::string bus_path;         // "1-2.3": bus, then the ports from the root
  bool accessible = false;
  std::string advice;  // what to do where it is not accessible
};

// What is plugged in, in order of bus path; nothing is sent to it.
std::vector<UsbLedsSeen> usb_leds_seen();

}  // namespace lightstage::capture
