#include "capture/hardware_rig.h"

#include "capture/gpio_lines.h"
#include "capture/led_group.h"
#include "capture/usb_leds.h"
#include "capture/v4l2_cameras.h"
#include "core/error.h"

namespace lightstage::capture {

namespace {

// The stage's lights that hang on the controller, in order, and where.
struct Share {
  std::vector<int> lights;
  std::vector<std::vector<int>> channels;
};

Share share_of(const ControllerSpec& controller, const std::vector<LightWiring>& wiring) {
  Share share;
  for (std::size_t i = 0; i < wiring.size(); ++i) {
    if (wiring[i].controller != controller.name) continue;
    share.lights.push_back(static_cast<int>(i));
    share.channels.push_back(wiring[i].channels);
  }
  return share;
}

std::vector<std::string> lights_off_command(const std::filesystem::path& program, const std::string& serial) {
  if (program.empty()) return {};
  return {program.string(), "lights-off", "--dmx-serial", serial};
}

std::unique_ptr<LedController> open_controller(const ControllerSpec& spec, const Share& share, core::Clock& clock,
                                               const HardwareOptions& options) {
  if (spec.kind == ControllerKind::kEnttecDmxUsbPro) {
    return open_dmx_widget(spec.serial, share.channels, clock, lights_off_command(options.program, spec.serial));
  }
  std::vector<int> outputs;
  for (const std::vector<int>& channels : share.channels) outputs.push_back(channels.front());
  return open_usb_leds(spec.serial, outputs, clock);
}

std::unique_ptr<LedController> open_lights(const Hardware& hardware, core::Clock& clock,
                                           const HardwareOptions& options) {
  std::vector<LedGroupMember> members;
  for (const ControllerSpec& spec : hardware.controllers) {
    const Share share = share_of(spec, hardware.wiring);
    members.push_back({spec.name, open_controller(spec, share, clock, options), share.lights});
  }
  if (members.size() == 1) return std::move(members.front().controller);  // its lights are the stage's, in their order
  return make_led_group(std::move(members));
}

void require_controllers(const Stage& stage) {
  if (stage.hardware.controllers.empty()) {
    throw core::UsageError("the file of stage '" + stage.name +
                           "' describes no LED controllers: add them (docs/hardware.md)");
  }
}

}  // namespace

struct HardwareRig::Impl {
  core::Clock& clock;
  std::unique_ptr<LedController> lights;
  std::vector<std::unique_ptr<Camera>> cameras;
  std::vector<Camera*> camera_pointers;
  std::unique_ptr<Trigger> trigger;
  std::unique_ptr<Strobe> strobe;
};

HardwareRig::HardwareRig(const Stage& stage, core::Clock& clock, const HardwareOptions& options)
    : impl_(std::make_unique<Impl>(Impl{.clock = clock})) {
  require_controllers(stage);
  const Hardware& hardware = stage.hardware;
  if (hardware.cameras.empty()) {
    throw core::UsageError("the file of stage '" + stage.name +
                           "' says of no camera which device it is: add a [camera.device] to each (docs/hardware.md)");
  }
  impl_->lights = open_lights(hardware, clock, options);
  // The trigger before the cameras: an idle line that was left active would start an exposure when it is put right.
  if (hardware.trigger) impl_->trigger = open_gpio_trigger(*hardware.trigger, clock);
  if (hardware.strobe) impl_->strobe = open_gpio_strobe(*hardware.strobe, clock);
  for (std::size_t i = 0; i < hardware.cameras.size(); ++i) {
    impl_->cameras.push_back(open_v4l2_camera(stage.cameras.at(i), hardware.cameras[i], clock));
    impl_->camera_pointers.push_back(impl_->cameras.back().get());
  }
  impl_->lights->all_off();
}

HardwareRig::~HardwareRig() = default;

Rig HardwareRig::rig() {
  return {.lights = *impl_->lights,
          .trigger = impl_->trigger.get(),
          .cameras = impl_->camera_pointers,
          .clock = impl_->clock,
          .strobe = impl_->strobe.get()};
}

std::vector<std::string> turn_lights_off(const Stage& stage, core::Clock& clock) {
  require_controllers(stage);
  std::vector<std::string> failures;
  for (const ControllerSpec& spec : stage.hardware.controllers) {
    try {
      usb_lights_off(spec.kind, spec.serial, clock);
    } catch (const core::Error& error) {
      failures.push_back("controller " + spec.name + ": " + error.what());
    }
  }
  return failures;
}

}  // namespace lightstage::capture
