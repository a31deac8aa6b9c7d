// For controllers that keep their last pattern for ever: a process that turns the lights off when this one dies. Room-internal.
#pragma once

#include <string>
#include <vector>

namespace lightstage::capture {

// A small process, in a session of its own so that Ctrl-C and the terminal's end do not reach it, that waits for this one's
// end. When this process ends in any way, also by SIGKILL, while lights may be on, it becomes `command`.
//
// Make it before devices are opened and before much memory is in use: the other process keeps what was there as long as this one
// changes it.
class LightsOffOnDeath {
 public:
  // A program by its path ("/proc/self/exe" is this one) and its arguments. No light is on yet. Throws DeviceError when no
  // process can be made.
  explicit LightsOffOnDeath(const std::vector<std::string>& command);
  // Runs the command if lights may be on.
  ~LightsOffOnDeath();
  LightsOffOnDeath(const LightsOffOnDeath&) = delete;
  LightsOffOnDeath& operator=(const LightsOffOnDeath&) = delete;

  // Say the first before any light is switched on, the second when all are certainly off.
  void lights_on() noexcept { tell(true); }
  void lights_off() noexcept { tell(false); }

 private:
  void tell(bool on) noexcept;

  int socket_ = -1;  // whose other end the process reads
  bool on_ = false;
};

}  // namespace lightstage::capture
