// A stream of bytes to and from an LED controller: a USB pipe, or memory where the controller is simulated.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "core/clock.h"

namespace lightstage::capture {

// After either function has thrown, its next call tries to reach the same device again: what the controller knew of the
// host may be gone then. Deadlines are on the clock of who uses the link.
class LedLink {
 public:
  virtual ~LedLink() = default;
  // Sends all bytes. Where they cannot be sent until the deadline, some of them may have been: returns all the same,
  // the missing answer will tell. Throws DeviceError when the device is gone, missing or not permitted.
  virtual void write(std::span<const std::uint8_t> bytes, core::Nanoseconds deadline) = 0;
  // What has come, as soon as anything has; empty when nothing did until the deadline. Throws DeviceError when the device
  // is gone.
  virtual std::vector<std::uint8_t> read(core::Nanoseconds deadline) = 0;
};

}  // namespace lightstage::capture
