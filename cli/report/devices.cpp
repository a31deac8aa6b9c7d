#include "cli/report/devices.h"

#include <nlohmann/json.hpp>

#include "core/text.h"

namespace lightstage::cli {

using nlohmann::ordered_json;

namespace {

std::string_view kind_name(capture::ControllerKind kind) {
  return kind == capture::ControllerKind::kLightstage ? "lightstage" : "enttec_dmx_usb_pro";
}

// "320x240 (up to 60 per second)"
std::string size_text(const capture::V4l2Size& size) {
  std::string text = std::to_string(size.width) + "x" + std::to_string(size.height);
  if (size.largest_width > size.width || size.largest_height > size.height) {
    text += " to " + std::to_string(size.largest_width) + "x" + std::to_string(size.largest_height);
  }
  return size.rates.empty() ? text : text + " (up to " + core::number_text(size.rates.front(), 4) + " per second)";
}

std::string format_text(const capture::V4l2Format& format) {
  if (!format.refused.empty()) return "not usable: " + format.refused;
  std::string sizes;
  for (const capture::V4l2Size& size : format.sizes) sizes += (sizes.empty() ? "" : ", ") + size_text(size);
  return sizes;
}

// A line for all formats of which the same is to be said.
std::string formats_text(const std::vector<capture::V4l2Format>& formats) {
  std::vector<std::pair<std::string, std::string>> lines;  // what is to be said, and of which formats
  for (const capture::V4l2Format& format : formats) {
    const std::string about = format_text(format);
    const auto same = std::find_if(lines.begin(), lines.end(), [&](const auto& line) { return line.first == about; });
    if (same == lines.end()) {
      lines.emplace_back(about, format.pixel_format);
    } else {
      same->second += ", " + format.pixel_format;
    }
  }
  std::string text;
  for (const auto& [about, names] : lines) text += "             " + names + ": " + about + "\n";
  return text;
}

std::string camera_text(const capture::V4l2CameraSeen& camera) {
  std::string text = "camera     " + camera.node + ": " + camera.card;
  if (!camera.driver.empty()) text += " (" + camera.driver + ")";
  text += camera.serial.empty() ? ", no serial number" : ", serial number " + camera.serial;
  if (!camera.bus_path.empty()) text += ", at " + camera.bus_path;
  if (camera.has_trigger) text += ", trigger can be switched";
  return text + "\n" + formats_text(camera.formats);
}

std::string line_text(const capture::GpioLineSeen& line, std::size_t number) {
  std::string text = std::to_string(number);
  if (!line.name.empty()) text += " '" + line.name + "'";
  if (line.used) text += " (held by " + (line.consumer.empty() ? std::string("somebody") : line.consumer) + ")";
  return text;
}

std::string chip_text(const capture::GpioChipSeen& chip) {
  std::string text = "GPIO chip  " + chip.path;
  if (!chip.label.empty()) text += ": label " + chip.label;
  for (std::size_t i = 0; i < chip.lines.size(); ++i)
    text += (i == 0 ? ", lines " : ", ") + line_text(chip.lines[i], i);
  return text + "\n";
}

std::string controller_text(const capture::UsbLedsSeen& controller) {
  std::string text = "LEDs       " + std::string(kind_name(controller.kind));
  if (!controller.certain) text += ", or any serial adapter";
  text += controller.serial.empty() ? ", no serial number" : ", serial number " + controller.serial;
  if (!controller.product.empty()) text += ", " + controller.product;
  return text + ", at " + controller.bus_path + (controller.accessible ? "" : " (no permission)") + "\n";
}

}  // namespace

std::string devices_text(const capture::DevicesSeen& seen) {
  std::string text;
  for (const capture::UsbLedsSeen& controller : seen.controllers) text += controller_text(controller);
  for (const capture::V4l2CameraSeen& camera : seen.cameras) text += camera_text(camera);
  for (const capture::GpioChipSeen& chip : seen.gpio_chips) text += chip_text(chip);
  return text.empty() ? "devices    no LED controllers, cameras or GPIO chips seen\n" : text;
}

ordered_json devices_json(const capture::DevicesSeen& seen) {
  ordered_json controllers = ordered_json::array(), cameras = ordered_json::array(), chips = ordered_json::array();
  for (const capture::UsbLedsSeen& c : seen.controllers) {
    controllers.push_back({{"kind", kind_name(c.kind)},
                           {"certain", c.certain},
                           {"serial", c.serial},
                           {"product", c.product},
                           {"vendor_product", c.vendor_product},
                           {"bus_path", c.bus_path},
                           {"accessible", c.accessible}});
  }
  for (const capture::V4l2CameraSeen& c : seen.cameras) {
    ordered_json formats = ordered_json::array();
    for (const capture::V4l2Format& format : c.formats) {
      ordered_json sizes = ordered_json::array();
      for (const capture::V4l2Size& size : format.sizes) {
        sizes.push_back({{"width", size.width},
                         {"height", size.height},
                         {"largest_width", size.largest_width},
                         {"largest_height", size.largest_height},
                         {"rates", size.rates}});
      }
      formats.push_back({{"pixel_format", format.pixel_format}, {"refused", format.refused}, {"sizes", sizes}});
    }
    cameras.push_back({{"node", c.node},
                       {"card", c.card},
                       {"driver", c.driver},
                       {"serial", c.serial},
                       {"bus_path", c.bus_path},
                       {"has_trigger", c.has_trigger},
                       {"formats", formats},
                       {"problem", c.problem}});
  }
  for (const capture::GpioChipSeen& c : seen.gpio_chips) {
    ordered_json lines = ordered_json::array();
    for (const capture::GpioLineSeen& line : c.lines) {
      lines.push_back({{"name", line.name}, {"output", line.output}, {"used", line.used}, {"consumer", line.consumer}});
    }
    chips.push_back({{"path", c.path}, {"label", c.label}, {"lines", lines}, {"problem", c.problem}});
  }
  return {{"controllers", controllers}, {"cameras", cameras}, {"gpio_chips", chips}};
}

}  // namespace lightstage::cli
