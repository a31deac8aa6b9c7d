// The hardware part of stage files: TOML out and in.
#include <algorithm>
#include <map>
#include <numeric>
#include <set>
#include <utility>

#include "capture/led_protocol.h"
#include "capture/stage.h"
#include "capture/toml/hardware.h"
#include "capture/toml/number.h"
#include "capture/toml/text.h"
#include "capture/usb/dmx_message.h"
#include "capture/v4l2/pixel_format.h"
#include "core/text.h"

namespace lightstage::capture {

namespace {

constexpr int kHighestOutput = static_cast<int>(kMaxLedOutputs) - 1;
constexpr int kHighestDmxChannel = static_cast<int>(kDmxChannels);  // they count from 1
constexpr double kShortestPulseUs = 1, kLongestPulseUs = 1e6;
constexpr double kLargestOffsetMs = 10e3;
constexpr std::size_t kMostCoefficients = 8;

std::string_view to_string(ControllerKind kind) {
  return kind == ControllerKind::kLightstage ? "lightstage" : "enttec_dmx_usb_pro";
}

std::string_view to_string(bool value) {
  return value ? "true" : "false";
}

template <class Values, class Text>
std::string list(const Values& values, Text text) {
  std::string result = "[";
  for (const auto& value : values) result += (result.size() > 1 ? ", " : "") + text(value);
  return result + "]";
}

// A text that must say something: an empty one is a field that was forgotten.
std::string filled_in(const core::TomlTable& table, std::string_view key) {
  std::string text = table.string(key);
  if (text.empty()) table.fail(key, "must not be empty");
  return text;
}

// Controllers.

ControllerSpec read_controller(const core::TomlTable& table) {
  ControllerSpec controller;
  controller.name = table.string("name");
  if (!valid_stage_name(controller.name)) table.fail("name", "must be made of letters, digits, '-', '_' and '.'");
  const std::string kind = table.string("kind");
  if (kind == to_string(ControllerKind::kEnttecDmxUsbPro)) {
    controller.kind = ControllerKind::kEnttecDmxUsbPro;
  } else if (kind != to_string(ControllerKind::kLightstage)) {
    table.fail("kind", "must be lightstage or enttec_dmx_usb_pro");
  }
  controller.serial = table.string("serial", "");
  return controller;
}

std::vector<ControllerSpec> read_controllers(const core::TomlTable& stage) {
  std::vector<ControllerSpec> controllers;
  for (const core::TomlTable& entry : stage.tables("controller")) {
    const ControllerSpec controller = read_controller(entry);
    for (const ControllerSpec& other : controllers) {
      if (other.name == controller.name) entry.fail("name", "is another controller's already");
      if (other.kind != controller.kind) continue;
      if (other.serial.empty() || controller.serial.empty()) {
        entry.fail("serial", "is needed to tell '" + controller.name + "' and '" + other.name +
                                 "' apart: give both (see `lightstage doctor`)");
      }
      if (other.serial == controller.serial) entry.fail("serial", "is that of controller '" + other.name + "' already");
    }
    controllers.push_back(controller);
  }
  return controllers;
}

// The wiring of lights, one after another, with what is taken already.
class WiringReader {
 public:
  explicit WiringReader(const std::vector<ControllerSpec>& controllers) : controllers_(controllers) {}

  LightWiring read(const core::TomlTable& light, std::size_t index) {
    const ControllerSpec& controller = find_controller(light);
    LightWiring wiring{controller.name, read_channels(light, controller)};
    for (const int channel : wiring.channels) {
      const auto [place, is_new] = light_of_channel_.try_emplace({controller.name, channel}, index);
      if (is_new) continue;
      const std::string taken =
          place->second == index ? "twice for this light" : "light " + std::to_string(place->second) + "'s already";
      light.fail("channels", "names channel " + std::to_string(channel) + " of controller '" + controller.name +
                                 "', which is " + taken);
    }
    ++lights_of_[controller.name];
    return wiring;
  }

  bool drives_a_light(const std::string& controller) const { return lights_of_.contains(controller); }

 private:
  const ControllerSpec& find_controller(const core::TomlTable& light) const {
    if (!light.has("controller")) {
      if (controllers_.size() == 1) return controllers_.front();
      light.fail("controller", "is missing: the stage has " + std::to_string(controllers_.size()));
    }
    const std::string name = light.string("controller");
    std::vector<std::string> names;
    for (const ControllerSpec& controller : controllers_) {
      if (controller.name == name) return controller;
      names.push_back(controller.name);
    }
    light.fail("controller",
               "names '" + name + "', which is no [[controller]] of this file" + core::did_you_mean(name, names));
  }

  std::vector<int> read_channels(const core::TomlTable& light, const ControllerSpec& controller) {
    const bool dmx = controller.kind == ControllerKind::kEnttecDmxUsbPro;
    if (!light.has("channels")) {
      if (dmx) light.fail("channels", "is missing: a light on a DMX widget has 1 or 3 channels from 1 to 512");
      return {lights_of_[controller.name]};
    }
    const std::vector<double> numbers = light.numbers("channels");
    if (dmx ? numbers.size() != 1 && numbers.size() != 3 : numbers.size() != 1) {
      light.fail("channels", dmx ? "must be 1 or 3 DMX channels" : "must be one output of the controller");
    }
    const int lowest = dmx ? 1 : 0, highest = dmx ? kHighestDmxChannel : kHighestOutput;
    std::vector<int> channels;
    for (const double number : numbers) {
      if (number != std::floor(number) || number < lowest || number > highest) {
        light.fail("channels",
                   "must hold whole numbers from " + std::to_string(lowest) + " to " + std::to_string(highest));
      }
      channels.push_back(static_cast<int>(number));
    }
    return channels;
  }

  const std::vector<ControllerSpec>& controllers_;
  std::map<std::pair<std::string, int>, std::size_t> light_of_channel_;
  std::map<std::string, int> lights_of_;
};

std::vector<LightWiring> read_wiring(const core::TomlTable& stage, const std::vector<ControllerSpec>& controllers) {
  const std::vector<core::TomlTable> lights = stage.tables("light");
  if (controllers.empty()) {
    for (const core::TomlTable& light : lights) {
      for (const char* key : {"controller", "channels"}) {
        if (light.has(key)) light.fail(key, "is of no use: the file has no [[controller]]");
      }
    }
    return {};
  }
  WiringReader reader(controllers);
  std::vector<LightWiring> wiring;
  for (std::size_t i = 0; i < lights.size(); ++i) wiring.push_back(reader.read(lights[i], i));
  const std::vector<core::TomlTable> entries = stage.tables("controller");
  for (std::size_t i = 0; i < controllers.size() && !lights.empty(); ++i) {
    if (!reader.drives_a_light(controllers[i].name)) entries[i].fail("name", "is of a controller that no light names");
  }
  return wiring;
}

// Cameras.

std::string read_pixel_format(const core::TomlTable& table, const std::string& default_format) {
  if (!table.has("pixel_format")) return default_format;
  const std::optional<std::uint32_t> fourcc = parse_fourcc(table.string("pixel_format"));
  if (!fourcc) table.fail("pixel_format", "must be the driver's four characters, such as GREY, Y10, Y16, RGGB or YUYV");
  const std::string refused = refusal(*fourcc);
  if (!refused.empty()) table.fail("pixel_format", "cannot be measured in: " + refused);
  return fourcc_text(*fourcc);
}

std::vector<double> read_linearisation(const core::TomlTable& table, const std::vector<double>& default_value) {
  if (!table.has("linearisation")) return default_value;
  std::vector<double> coefficients = table.numbers("linearisation");
  if (coefficients.empty() || coefficients.size() > kMostCoefficients) {
    table.fail("linearisation", "must have 1 to " + std::to_string(kMostCoefficients) + " coefficients");
  }
  if (std::accumulate(coefficients.begin(), coefficients.end(), 0.0) <= 0) {
    table.fail("linearisation", "must map full scale to something above 0");
  }
  return coefficients;
}

CameraDevice read_device(const core::TomlTable& table) {
  CameraDevice device;
  device.match = filled_in(table, "match");
  device.pixel_format = read_pixel_format(table, device.pixel_format);
  if (table.has("gain")) {
    const std::int64_t gain = table.integer("gain");
    if (!std::in_range<int>(gain)) table.fail("gain", "must fit into 32 bits");
    device.gain = static_cast<int>(gain);
  }
  device.black_level = table.number("black_level", device.black_level);
  if (device.black_level < 0) table.fail("black_level", "must not be negative");
  device.linearisation = read_linearisation(table, device.linearisation);
  device.triggered = table.boolean("triggered", device.triggered);
  const double offset_ms = table.number("timestamp_offset_ms", 0);
  if (std::abs(offset_ms) > kLargestOffsetMs) table.fail("timestamp_offset_ms", "must be -10000 to 10000 (10 s)");
  device.timestamp_offset = core::from_units(offset_ms, core::kMillisecond);
  return device;
}

std::vector<CameraDevice> read_devices(const core::TomlTable& stage) {
  const std::vector<core::TomlTable> cameras = stage.tables("camera");
  const auto has_device = [](const core::TomlTable& camera) { return camera.has("device"); };
  std::vector<CameraDevice> devices;
  if (std::none_of(cameras.begin(), cameras.end(), has_device)) return devices;
  for (const core::TomlTable& camera : cameras) {
    if (!camera.has("device")) camera.fail("device", "is missing: other cameras have one");
    const core::TomlTable table = camera.table("device");
    devices.push_back(read_device(table));
    for (std::size_t other = 0; other + 1 < devices.size(); ++other) {
      if (devices[other].match == devices.back().match) {
        table.fail("match", "is that of camera '" + cameras[other].string("name") + "' already");
      }
    }
    if (devices.back().triggered && !stage.has("trigger")) {
      table.fail("triggered", "needs a [trigger] in the file; a camera that only runs free says triggered = false");
    }
  }
  return devices;
}

// Lines.

TriggerSpec read_trigger(const core::TomlTable& table, std::size_t camera_count) {
  TriggerSpec trigger;
  trigger.chip = filled_in(table, "chip");
  trigger.lines = table.strings("lines");
  if (trigger.lines.size() != 1 && trigger.lines.size() != camera_count) {
    table.fail("lines", "must be one for all cameras or one for each of the " + std::to_string(camera_count));
  }
  if (std::set<std::string>(trigger.lines.begin(), trigger.lines.end()).size() != trigger.lines.size()) {
    table.fail("lines", "names a line twice");
  }
  if (std::any_of(trigger.lines.begin(), trigger.lines.end(), [](const auto& line) { return line.empty(); })) {
    table.fail("lines", "must not be empty");
  }
  const double pulse_us = table.number("pulse_us", core::in_units(trigger.pulse, core::kMicrosecond));
  if (pulse_us < kShortestPulseUs || pulse_us > kLongestPulseUs) table.fail("pulse_us", "must be 1 to 1000000 (1 s)");
  trigger.pulse = core::from_units(pulse_us, core::kMicrosecond);
  trigger.active_low = table.boolean("active_low", false);
  return trigger;
}

StrobeSpec read_strobe(const core::TomlTable& table, const std::optional<TriggerSpec>& trigger) {
  StrobeSpec strobe;
  strobe.chip = filled_in(table, "chip");
  strobe.line = filled_in(table, "line");
  strobe.active_low = table.boolean("active_low", false);
  if (trigger && trigger->chip == strobe.chip &&
      std::find(trigger->lines.begin(), trigger->lines.end(), strobe.line) != trigger->lines.end()) {
    table.fail("line", "is a trigger line: an output cannot hear");
  }
  return strobe;
}

constexpr std::string_view kTemplate = R"(
# The devices of a real stage; docs/hardware.md says how to wire and describe them, `lightstage doctor` what is plugged in.
# [[controller]]
# name = "leds"
# kind = "lightstage"            # or enttec_dmx_usb_pro; then each light has: channels = [1, 2, 3]
# serial = ""                    # empty: the only one plugged in
# [trigger]
# chip = "cp2112_gpio"           # the GPIO chip's label
# lines = ["0"]                  # by name or number: one for all cameras, or one for each
# pulse_us = 1000.0
# At the end of each camera:
# [camera.device]
# match = "SERIAL"               # or its bus path
# pixel_format = "Y16"
)";

}  // namespace

Hardware read_hardware(const core::TomlTable& stage) {
  Hardware hardware;
  hardware.controllers = read_controllers(stage);
  hardware.wiring = read_wiring(stage, hardware.controllers);
  hardware.cameras = read_devices(stage);
  if (const auto table = stage.optional_table("trigger")) {
    hardware.trigger = read_trigger(*table, stage.tables("camera").size());
  }
  if (const auto table = stage.optional_table("strobe")) hardware.strobe = read_strobe(*table, hardware.trigger);
  return hardware;
}

std::string controllers_and_lines_toml(const Hardware& hardware) {
  if (hardware == Hardware{}) return std::string(kTemplate);
  std::string text;
  for (const ControllerSpec& controller : hardware.controllers) {
    text += "\n[[controller]]\nname = " + toml_string(controller.name) + "\n";
    text += "kind = \"" + std::string(to_string(controller.kind)) + "\"\n";
    text += "serial = " + toml_string(controller.serial) + "\n";
  }
  if (hardware.trigger) {
    text += "\n[trigger]\nchip = " + toml_string(hardware.trigger->chip) + "\n";
    text += "lines = " + list(hardware.trigger->lines, [](const std::string& l) { return toml_string(l); }) + "\n";
    text += "pulse_us = " + toml_number(core::in_units(hardware.trigger->pulse, core::kMicrosecond)) + "\n";
    text += "active_low = " + std::string(to_string(hardware.trigger->active_low)) + "\n";
  }
  if (hardware.strobe) {
    text += "\n[strobe]\nchip = " + toml_string(hardware.strobe->chip) + "\n";
    text += "line = " + toml_string(hardware.strobe->line) + "\n";
    text += "active_low = " + std::string(to_string(hardware.strobe->active_low)) + "\n";
  }
  return text;
}

std::string device_toml(const CameraDevice& device) {
  std::string text = "[camera.device]\nmatch = " + toml_string(device.match) + "\n";
  text += "pixel_format = " + toml_string(device.pixel_format) + "\n";
  if (device.gain) text += "gain = " + std::to_string(*device.gain) + "\n";
  text += "black_level = " + toml_number(device.black_level) + "\n";
  text += "linearisation = " + list(device.linearisation, toml_number) + "\n";
  text += "triggered = " + std::string(to_string(device.triggered)) + "\n";
  text += "timestamp_offset_ms = " + toml_number(core::in_units(device.timestamp_offset, core::kMillisecond)) + "\n";
  return text;
}

std::string wiring_toml(const LightWiring& wiring) {
  return "controller = " + toml_string(wiring.controller) +
         "\nchannels = " + list(wiring.channels, [](int channel) { return std::to_string(channel); }) + "\n";
}

}  // namespace lightstage::capture
