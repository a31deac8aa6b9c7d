// Triggers and strobes on the GPIO lines that Linux offers as character devices (/dev/gpiochip*).
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "capture/devices.h"
#include "capture/hardware.h"
#include "core/clock.h"

namespace lightstage::capture {

// Opens the lines as outputs, inactive. Every fire() pulses all of them, in one request to the chip.
//
// A pulse is never shorter than `spec.pulse`; it is longer by what the chip takes for one change and, from 0.1 ms up, by what
// the system takes to wake a sleeper. The lines are inactive afterwards on every way out, and when the trigger is
// destroyed. What was set is read back where the chip can tell, because a chip on a bus may lose a change and report
// success: the inactive level always, the active one unless reading takes longer than the pulse (both are said once, by
// core::note).
//
// Throws DeviceError naming chip and line: at opening when the chip or line is not there, ambiguous, held by another
// program (which is named) or not permitted; at firing when the chip is gone, fails, or a line does not follow. After an
// error the next fire() opens the lines again, by label; a chip that was unplugged gets 3 s to come back. `clock` must
// outlive the trigger.
std::unique_ptr<Trigger> open_gpio_trigger(const TriggerSpec& spec, core::Clock& clock);

// Hears the edges at which `spec.line` becomes active, as the start of exposures, with the kernel's time stamps. Those are
// CLOCK_MONOTONIC from Linux 5.7 on: an edge stamped in the future or before the line was opened throws DeviceError, so
// `clock` must be the system's. Errors and reopening as above. A chip that asks its device only now and then hears
// short pulses late or not at all (the CP2112 driver polls every 40 ms or so).
std::unique_ptr<Strobe> open_gpio_strobe(const StrobeSpec& spec, core::Clock& clock);

struct GpioLineSeen {
  std::string name;  // empty where the chip names none; a line is also found by its number, the place in the list
  bool output = false;
  bool used = false;     // by the kernel or a program: cannot be opened
  std::string consumer;  // who uses it, as far as that is known
};

struct GpioChipSeen {
  std::string path;   // "/dev/gpiochip0"
  std::string label;  // what stage files call it; empty when it could not be opened
  std::vector<GpioLineSeen> lines;
  std::string problem;  // why it could not be opened; empty: it could
};

// The GPIO chips of this machine in order of their numbers, looked at without taking a line.
std::vector<GpioChipSeen> gpio_chips_seen();

}  // namespace lightstage::capture
