// Lights behind a DMX512 widget, over any link that carries the widget's messages. Room-internal.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "capture/devices.h"
#include "capture/led_link.h"
#include "capture/usb/dmx_message.h"
#include "capture/usb/lights_off_on_death.h"

namespace lightstage::capture {

struct DmxLedsOptions {
  std::string name = "DMX widget";                  // as error messages call it
  std::vector<std::vector<int>> channels_of_light;  // each one or three, from 1 to 512, none twice
};

// A widget acknowledges nothing, so that each pattern is followed by a request for its parameters, which it answers in turn; both are
// repeated when no answer comes in 100 ms, three times in all. See open_dmx_widget (capture/usb_leds.h).
class DmxLeds : public LedController {
 public:
  // Everything is off afterwards. Throws DeviceError when what is there does not answer as a widget; UsageError for channels that
  // cannot be.
  DmxLeds(std::unique_ptr<LedLink> link, DmxLedsOptions options, core::Clock& clock,
          std::unique_ptr<LightsOffOnDeath> guard = {});
  // Turns everything off; where that fails, the guard does it.
  ~DmxLeds() override;
  DmxLeds(const DmxLeds&) = delete;
  DmxLeds& operator=(const DmxLeds&) = delete;

  std::size_t light_count() const override { return options_.channels_of_light.size(); }
  void show(std::span<const LightLevel> levels) override;
  void all_off() override;
  // A widget measures nothing; throws when it is gone.
  LedStatus status() override;

 private:
  // Sends all of it and waits for the answer to a request for parameters behind it.
  void send(std::span<const std::uint8_t> bytes);
  void show_channels(std::span<const std::uint8_t> channels);
  void skip_late_answers();
  std::optional<DmxMessage> next_message(core::Nanoseconds deadline);

  std::unique_ptr<LightsOffOnDeath> guard_;  // outlives the link: the device must be free when it acts
  std::unique_ptr<LedLink> link_;
  DmxLedsOptions options_;
  core::Clock& clock_;
  std::size_t used_channels_ = 0;
  DmxReader reader_;
  DmxParameters parameters_;
  bool late_answers_ = true;  // from before, or of tries that were given up
};

}  // namespace lightstage::capture
