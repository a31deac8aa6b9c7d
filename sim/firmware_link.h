// A simulated LED controller at the end of a link in memory: what a program talks to instead of a USB device.
#pragma once

#include <deque>

#include "capture/led_link.h"
#include "core/clock.h"
#include "sim/led_firmware.h"

namespace lightstage::sim {

// Messages take no time; waiting for one lets the clock's time pass, up to the deadline. Controller and clock must outlive it.
class FirmwareLink : public capture::LedLink {
 public:
  FirmwareLink(LedFirmware& firmware, core::Clock& clock) : firmware_(firmware), clock_(clock) {}

  void write(std::span<const std::uint8_t> bytes, core::Nanoseconds deadline) override;
  std::vector<std::uint8_t> read(core::Nanoseconds deadline) override;

  // The strobe input will change at `time`, which must not be before the last one scheduled.
  void schedule_strobe(bool rising, core::Nanoseconds time);
  // Carries out what is due until the clock's time; write() and read() do so too.
  void catch_up();

 private:
  struct Edge {
    bool rising = false;
    core::Nanoseconds time = 0;
  };
  LedFirmware& firmware_;
  core::Clock& clock_;
  std::deque<Edge> strobe_;
};

}  // namespace lightstage::sim
