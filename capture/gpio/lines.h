// GPIO lines as triggers and strobes see them, whatever library reaches them.
#pragma once

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "capture/gpio_lines.h"
#include "core/clock.h"

namespace lightstage::capture {

// Lines of one chip. "Active" is high, or low where the request says so.
struct GpioRequest {
  std::string chip;                // by label, or by path
  std::vector<std::string> lines;  // by name, else by number; at most 64
  bool active_low = false;
};

// Held until destroyed, which leaves the lines at their last level. Every function throws DeviceError when the chip is
// gone or fails.
class GpioOutputs {
 public:
  virtual ~GpioOutputs() = default;
  virtual void set(bool active) = 0;  // all lines, in one request
  virtual std::vector<bool> read() = 0;
};

class GpioEdges {
 public:
  virtual ~GpioEdges() = default;
  // When the line next became active, by the kernel's clock; nothing when it did not within `timeout`, or when a signal
  // interrupted the wait.
  virtual std::optional<core::Nanoseconds> next_edge(core::Nanoseconds timeout) = 0;
  // Throws DeviceError when the chip is gone: waiting alone does not tell.
  virtual void check() = 0;
};

class GpioChips {
 public:
  virtual ~GpioChips() = default;
  // Finds the chip anew every time. Throws DeviceError as open_gpio_trigger. Outputs start inactive.
  virtual std::unique_ptr<GpioOutputs> open_outputs(const GpioRequest& request) = 0;
  virtual std::unique_ptr<GpioEdges> open_edges(const GpioRequest& request) = 0;
};

// Those of this machine, through libgpiod's first API.
std::unique_ptr<GpioChips> system_gpio_chips();

// "GPIO cp2112_gpio, lines 0 1", for messages.
std::string describe(const GpioRequest& request);

}  // namespace lightstage::capture
