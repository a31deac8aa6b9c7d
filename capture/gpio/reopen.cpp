#include "capture/gpio/reopen.h"

#include "core/error.h"
#include "core/interrupt.h"

namespace lightstage::capture {

namespace {
constexpr core::Nanoseconds kPatience = 3 * core::kSecond;
constexpr core::Nanoseconds kPause = 20 * core::kMillisecond;
}  // namespace

void reopen(core::Clock& clock, const std::function<void()>& open) {
  const core::Nanoseconds deadline = clock.now() + kPatience;
  while (true) {
    try {
      return open();
    } catch (const core::DeviceError&) {
      if (clock.now() >= deadline) throw;
    }
    core::throw_if_interrupted();
    clock.sleep_until(clock.now() + kPause);
  }
}

}  // namespace lightstage::capture
