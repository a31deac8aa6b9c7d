// Lights that go off on every way out.
#pragma once

#include "capture/devices.h"

namespace lightstage::capture {

// Its end of life turns every light off, trying a controller that fails several times; if all fail it warns
// and does not throw.
class LightsOffGuard {
 public:
  explicit LightsOffGuard(LedController& lights) : lights_(lights) {}
  ~LightsOffGuard();
  LightsOffGuard(const LightsOffGuard&) = delete;
  LightsOffGuard& operator=(const LightsOffGuard&) = delete;

  // The same now, for the way out that can report it: throws the controller's last error when every try
  // failed.
  void turn_off();

 private:
  LedController& lights_;
  bool off_ = false;
};

}  // namespace lightstage::capture
