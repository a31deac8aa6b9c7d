// Edges on an input line.
#pragma once

#include <memory>

#include "capture/devices.h"
#include "capture/gpio/lines.h"
#include "capture/hardware.h"
#include "core/clock.h"

namespace lightstage::capture {

// See open_gpio_strobe.
class GpioStrobe final : public Strobe {
 public:
  GpioStrobe(const StrobeSpec& spec, std::unique_ptr<GpioChips> chips, core::Clock& clock);

  // Throws DeviceError when pulses come faster than they can be thrown away.
  void clear() override;
  std::optional<core::Nanoseconds> wait_exposure(core::Nanoseconds deadline) override;

 private:
  void open();
  void open_if_needed();
  std::optional<core::Nanoseconds> next_edge(core::Nanoseconds deadline);
  void check_time(core::Nanoseconds edge) const;

  GpioRequest request_;
  std::unique_ptr<GpioChips> chips_;
  core::Clock& clock_;
  std::unique_ptr<GpioEdges> edges_;  // null after an error
  core::Nanoseconds opened_ = 0;
};

}  // namespace lightstage::capture
