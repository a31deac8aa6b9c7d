// A stage's hardware compared with the devices that are plugged in.
#include <algorithm>
#include <filesystem>

#include "capture/devices_seen.h"
#include "core/text.h"

namespace lightstage::capture {

namespace {

std::string list(const std::vector<std::string>& words) {
  return words.empty() ? "none" : core::joined(words, ", ");
}

// Collects what is wrong with one part of the stage file.
class Findings {
 public:
  Findings(std::string part, std::vector<std::string>& lines) : part_(std::move(part)), lines_(lines) {}
  void add(const std::string& problem) { lines_.push_back(part_ + ": " + problem); }

 private:
  std::string part_;
  std::vector<std::string>& lines_;
};

std::string_view kind_name(ControllerKind kind) {
  return kind == ControllerKind::kLightstage ? "lightstage controller" : "DMX widget";
}

void check_controller(const ControllerSpec& spec, const DevicesSeen& seen, Findings findings) {
  const std::string what(kind_name(spec.kind));
  std::vector<const UsbLedsSeen*> matching;
  std::vector<std::string> serials;
  for (const UsbLedsSeen& controller : seen.controllers) {
    if (controller.kind != spec.kind) continue;
    serials.push_back(controller.serial.empty() ? "one without, at " + controller.bus_path : controller.serial);
    if (spec.serial.empty() || spec.serial == controller.serial) matching.push_back(&controller);
  }
  if (matching.empty() && spec.serial.empty()) return findings.add("no " + what + " is plugged in");
  if (matching.empty()) {
    return findings.add("no " + what + " with the serial number '" + spec.serial +
                        "' is plugged in (there are: " + list(serials) + "): plug it in, or correct `serial`");
  }
  if (matching.size() > 1) {
    return findings.add("there are several (" + list(serials) + "): say which by `serial`");
  }
  if (!matching.front()->accessible) findings.add(matching.front()->advice);
}

bool matches(const V4l2CameraSeen& camera, const std::string& match) {
  if (!match.starts_with('/')) return match == camera.serial || match == camera.bus_path;
  std::error_code unresolved;
  return std::filesystem::weakly_canonical(match, unresolved) == camera.node || match == camera.node;
}

bool offers(const V4l2Size& size, int width, int height) {
  const auto fits = [](int smallest, int largest, int step, int wanted) {
    return wanted == smallest ||
           (wanted > smallest && wanted <= largest && (wanted - smallest) % std::max(1, step) == 0);
  };
  return fits(size.width, size.largest_width, size.width_step, width) &&
         fits(size.height, size.largest_height, size.height_step, height);
}

std::string text(const V4l2Size& size) {
  std::string smallest = std::to_string(size.width) + "x" + std::to_string(size.height);
  if (size.largest_width <= size.width && size.largest_height <= size.height) return smallest;
  return smallest + " to " + std::to_string(size.largest_width) + "x" + std::to_string(size.largest_height);
}

void check_format(const V4l2CameraSeen& camera, const StageCamera& wanted, const CameraDevice& device,
                  Findings findings) {
  std::vector<std::string> usable;
  for (const V4l2Format& format : camera.formats) {
    if (format.pixel_format != device.pixel_format) {
      if (format.refused.empty()) usable.push_back(format.pixel_format);
      continue;
    }
    if (!format.refused.empty()) return findings.add("pixel format " + format.pixel_format + ": " + format.refused);
    const auto size_fits = [&](const V4l2Size& size) { return offers(size, wanted.model.width, wanted.model.height); };
    if (format.sizes.empty() || std::any_of(format.sizes.begin(), format.sizes.end(), size_fits)) return;
    std::vector<std::string> sizes;
    for (const V4l2Size& size : format.sizes) sizes.push_back(text(size));
    return findings.add("the camera has no " + std::to_string(wanted.model.width) + "x" +
                        std::to_string(wanted.model.height) + " in " + format.pixel_format + " but " + list(sizes) +
                        ": correct `width_pixels` and `height_pixels`");
  }
  findings.add("the camera has no pixel format " + device.pixel_format + " but " + list(usable) +
               ": correct `pixel_format`");
}

void check_camera(const StageCamera& wanted, const CameraDevice& device, const DevicesSeen& seen, Findings findings) {
  std::vector<const V4l2CameraSeen*> matching;
  std::vector<std::string> names;
  for (const V4l2CameraSeen& camera : seen.cameras) {
    names.push_back((camera.serial.empty() ? "" : camera.serial + " at ") + camera.bus_path);
    if (matches(camera, device.match)) matching.push_back(&camera);
  }
  if (matching.empty()) {
    return findings.add("no camera matches '" + device.match + "' (there are: " + list(names) +
                        "): plug it in, or correct `match`");
  }
  if (matching.size() > 1) {
    return findings.add("several cameras match '" + device.match + "': match by bus path (" + list(names) + ")");
  }
  if (!matching.front()->problem.empty()) return findings.add(matching.front()->problem);
  check_format(*matching.front(), wanted, device, findings);
}

// The line by name, else by number.
const GpioLineSeen* find_line(const GpioChipSeen& chip, const std::string& name_or_number) {
  for (const GpioLineSeen& line : chip.lines) {
    if (line.name == name_or_number) return &line;
  }
  const auto number = core::parse_integer(name_or_number);
  if (!number || *number < 0 || *number >= static_cast<std::int64_t>(chip.lines.size())) return nullptr;
  return &chip.lines[static_cast<std::size_t>(*number)];
}

void check_lines(const std::string& chip_label, const std::vector<std::string>& lines, const DevicesSeen& seen,
                 Findings findings) {
  std::vector<const GpioChipSeen*> matching;
  std::vector<std::string> names;
  for (const GpioChipSeen& chip : seen.gpio_chips) {
    names.push_back(chip.label.empty() ? chip.path + " (" + chip.problem + ")" : chip.label);
    if (chip.label == chip_label || chip.path == chip_label) matching.push_back(&chip);
  }
  if (matching.empty()) {
    return findings.add("no GPIO chip '" + chip_label + "' is plugged in (there are: " + list(names) +
                        "): plug it in, or correct `chip`");
  }
  if (matching.size() > 1) {
    return findings.add(matching[0]->path + " and " + matching[1]->path + " are both labelled '" + chip_label +
                        "': name one by its path in `chip`");
  }
  const GpioChipSeen& chip = *matching.front();
  if (!chip.problem.empty()) return findings.add(chip.path + ": " + chip.problem);
  for (const std::string& name : lines) {
    const GpioLineSeen* line = find_line(chip, name);
    if (line == nullptr) {
      findings.add("chip '" + chip_label + "' has no line '" + name + "': it has " + std::to_string(chip.lines.size()) +
                   ", from 0");
    } else if (line->used) {
      const std::string holder = line->consumer.empty() ? "another program or the kernel" : "'" + line->consumer + "'";
      findings.add("line " + name + " is held by " + holder + ": end it, or choose another line");
    }
  }
}

}  // namespace

std::vector<std::string> stage_problems(const Stage& stage, const DevicesSeen& seen) {
  const Hardware& hardware = stage.hardware;
  std::vector<std::string> problems;
  Findings whole("stage " + stage.name, problems);
  if (hardware.controllers.empty()) whole.add("the file has no [[controller]]: see docs/hardware.md");
  if (hardware.cameras.empty()) whole.add("no camera of the file has a [camera.device]: see docs/hardware.md");
  for (const ControllerSpec& controller : hardware.controllers) {
    check_controller(controller, seen, Findings("controller " + controller.name, problems));
  }
  for (std::size_t i = 0; i < hardware.cameras.size(); ++i) {
    check_camera(stage.cameras[i], hardware.cameras[i], seen, Findings("camera " + stage.cameras[i].name, problems));
  }
  if (hardware.trigger) {
    check_lines(hardware.trigger->chip, hardware.trigger->lines, seen, Findings("trigger", problems));
  }
  if (hardware.strobe) check_lines(hardware.strobe->chip, {hardware.strobe->line}, seen, Findings("strobe", problems));
  return problems;
}

}  // namespace lightstage::capture
