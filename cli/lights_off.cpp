#include <CLI/CLI.hpp>
#include <nlohmann/json.hpp>

#include "capture/hardware_rig.h"
#include "capture/usb_leds.h"
#include "cli/commands.h"
#include "core/error.h"
#include "core/text.h"

namespace lightstage::cli {

namespace {

struct Options {
  std::filesystem::path stage_file;
  std::optional<std::string> dmx_serial;
};

void turn_stage_off(const Options& options, Context& context) {
  const capture::Stage stage = capture::read_stage(options.stage_file);
  core::SystemClock clock;
  const std::vector<std::string> failures = capture::turn_lights_off(stage, clock);
  const std::size_t controllers = stage.hardware.controllers.size();
  context.result(failures.empty() ? "all lights of '" + stage.name + "' are off\n" : "",
                 {{"stage", stage.name}, {"controllers", controllers}, {"failed", failures}});
  if (!failures.empty()) {
    throw core::DeviceError("LIGHTS MAY STILL BE ON, cut their power: " + std::to_string(failures.size()) + " of " +
                            std::to_string(controllers) + " controllers do not obey: " + core::joined(failures, "; "));
  }
}

// The widget may still belong to the process that died.
void turn_widget_off(const std::string& serial) {
  core::SystemClock clock;
  const core::Nanoseconds deadline = clock.now() + 5 * core::kSecond;
  while (true) {
    try {
      return capture::usb_lights_off(capture::ControllerKind::kEnttecDmxUsbPro, serial, clock);
    } catch (const core::DeviceError&) {
      if (clock.now() > deadline) throw;
    }
    clock.sleep_until(clock.now() + 100 * core::kMillisecond);
  }
}

}  // namespace

void add_lights_off(CLI::App& program, Context& context) {
  CLI::App* command = program.add_subcommand("lights-off", "Turn every light of a stage off, whatever happened");
  command->footer("Example:\n  lightstage lights-off --stage stage.toml");
  auto options = std::make_shared<Options>();
  command->add_option("--stage", options->stage_file, "Stage file, with its controllers (docs/hardware.md)");
  // For the process that watches over a DMX widget (capture/hardware_rig.h): no group, so that help does not list it.
  command->add_option("--dmx-serial", options->dmx_serial)->group("");
  command->callback([options, &context] {
    if (options->dmx_serial) {
      turn_widget_off(*options->dmx_serial);
    } else if (!options->stage_file.empty()) {
      turn_stage_off(*options, context);
    } else {
      throw core::UsageError("--stage FILE is needed: the stage whose lights go off");
    }
  });
}

}  // namespace lightstage::cli
