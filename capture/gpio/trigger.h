// Pulses on output lines.
#pragma once

#include <memory>

#include "capture/devices.h"
#include "capture/gpio/lines.h"
#include "capture/hardware.h"
#include "core/clock.h"

namespace lightstage::capture {

// See open_gpio_trigger.
class GpioTrigger final : public Trigger {
 public:
  GpioTrigger(const TriggerSpec& spec, std::unique_ptr<GpioChips> chips, core::Clock& clock);
  ~GpioTrigger() override;
  GpioTrigger(const GpioTrigger&) = delete;
  GpioTrigger& operator=(const GpioTrigger&) = delete;

  core::Nanoseconds fire() override;

 private:
  void open();
  // Returns when the lines had been set.
  core::Nanoseconds pulse();
  // Says what the lines can be checked for; throws when one of them is active.
  void try_reading();
  // The lines that do not read as `active`, as text; empty when all do.
  std::string lines_against(bool active);
  void let_go() noexcept;

  GpioRequest request_;
  core::Nanoseconds pulse_;
  std::unique_ptr<GpioChips> chips_;
  core::Clock& clock_;
  std::unique_ptr<GpioOutputs> lines_;  // null after an error
  bool can_read_ = false;               // the chip tells the levels of outputs
  bool reads_in_pulse_ = false;         // fast enough to do so within a pulse
  bool told_ = false;                   // what cannot be checked has been said
};

}  // namespace lightstage::capture
