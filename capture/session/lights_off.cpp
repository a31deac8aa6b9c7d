#include "capture/session/lights_off.h"

#include <exception>

#include "core/progress.h"

namespace lightstage::capture {

namespace {
constexpr int kTries = 5;
}

LightsOffGuard::~LightsOffGuard() {
  if (off_) return;
  try {
    turn_off();
  } catch (const std::exception& error) {
    try {
      core::warn("LIGHTS MAY STILL BE ON: the controller does not obey (" + std::string(error.what()) +
                 "). Cut their power.");
    } catch (...) {  // nothing is left to tell it with
    }
  } catch (...) {
  }
}

void LightsOffGuard::turn_off() {
  for (int tries = 1; !off_; ++tries) {
    try {
      lights_.all_off();
      off_ = true;
    } catch (...) {
      if (tries == kTries) throw;
    }
  }
}

}  // namespace lightstage::capture
