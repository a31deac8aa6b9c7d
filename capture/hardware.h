// The devices that a real stage is wired to, as its stage file says: which controller lights which light, which video
// device is which camera, which line triggers them.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "core/clock.h"

namespace lightstage::capture {

enum class ControllerKind {
  kLightstage,       // the project's own protocol, docs/led-protocol.md
  kEnttecDmxUsbPro,  // a DMX512 widget that speaks the Enttec DMX USB Pro's messages
};

struct ControllerSpec {
  std::string name;  // within the stage file
  ControllerKind kind = ControllerKind::kLightstage;
  std::string serial;  // USB serial number; empty: the only device of its kind that is plugged in
  friend bool operator==(const ControllerSpec&, const ControllerSpec&) = default;
};

// Where one light hangs.
struct LightWiring {
  std::string controller;  // ControllerSpec::name
  // Own protocol: one number, the controller's output, from 0. DMX: channels from 1 to 512, three for red, green and blue
  // or one for a light of a single colour (which gives the mean of the three levels).
  std::vector<int> channels;
  friend bool operator==(const LightWiring&, const LightWiring&) = default;
};

struct CameraDevice {
  // How the camera is found again: its USB serial number, its bus path ("usb-0000:00:14.0-2", as VIDIOC_QUERYCAP tells), or a
  // device node ("/dev/video0", which another boot may number otherwise).
  std::string match;
  std::string pixel_format = "GREY";  // as four characters, of those that `lightstage doctor` lists
  std::optional<int> gain;            // in the driver's units; not set where empty
  double black_level = 0;             // raw value that no light gives, in the format's units
  // Gives the raw value, from 0 to 1 of full scale, that a linear sensor would have given: polynomial coefficients from the
  // first power up. {1} is a linear sensor.
  std::vector<double> linearisation = {1};
  bool triggered = true;                   // false: exposes on its own; good for timing mode free_run only
  core::Nanoseconds timestamp_offset = 0;  // added to the driver's time stamps
  friend bool operator==(const CameraDevice&, const CameraDevice&) = default;
};

struct TriggerSpec {
  // The GPIO chip's label, because numbers change when it is plugged in again; "/dev/gpiochip3" where two have one label.
  std::string chip;
  std::vector<std::string> lines;  // by name, or by number: one for all cameras, or one for each in their order
  core::Nanoseconds pulse = core::kMillisecond;
  bool active_low = false;
  friend bool operator==(const TriggerSpec&, const TriggerSpec&) = default;
};

struct StrobeSpec {
  std::string chip;
  std::string line;
  bool active_low = false;
  friend bool operator==(const StrobeSpec&, const StrobeSpec&) = default;
};

struct Hardware {
  std::vector<ControllerSpec> controllers;
  std::vector<LightWiring> wiring;    // one for each light of the stage, where there are controllers
  std::vector<CameraDevice> cameras;  // one for each camera of the stage, or none
  std::optional<TriggerSpec> trigger;
  std::optional<StrobeSpec> strobe;

  // A stage can be captured with when it has lights to switch and cameras to ask.
  bool complete() const { return !controllers.empty() && !cameras.empty(); }
  friend bool operator==(const Hardware&, const Hardware&) = default;
};

}  // namespace lightstage::capture
