// Ctrl-C and SIGTERM, turned into an exception at a place of our choosing.
#pragma once

namespace lightstage::core {

// While one lives, SIGINT and SIGTERM only set a flag; a second signal ends the process at once by the
// signal's default action. Restores what was there before.
class InterruptGuard {
 public:
  InterruptGuard();
  ~InterruptGuard();
  InterruptGuard(const InterruptGuard&) = delete;
  InterruptGuard& operator=(const InterruptGuard&) = delete;
};

bool interrupt_requested();
// Throws Interrupted when a signal has arrived; call between units of work.
void throw_if_interrupted();

}  // namespace lightstage::core
