#include "capture/gpio/trigger.h"

#include <algorithm>

#include "capture/gpio/reopen.h"
#include "core/error.h"
#include "core/progress.h"
#include "core/text.h"

namespace lightstage::capture {

namespace {

// Below this, waking up late would be a large part of the pulse.
constexpr core::Nanoseconds kShortPulse = 100'000;
constexpr int kTriesToRest = 3;
constexpr int kReadsTimed = 3;
// An order takes no chip so long that listens: drivers wait for seconds before they give up, and may report success then.
constexpr core::Nanoseconds kMute = core::kSecond;

// Waits without giving the processor away.
void spin_until(core::Clock& clock, core::Nanoseconds time) {
  for (core::Nanoseconds now = clock.now(); now < time;) {
    const core::Nanoseconds next = clock.now();
    if (next == now) return clock.sleep_until(time);  // a clock that only sleepers move
    now = next;
  }
}

std::string milliseconds(core::Nanoseconds time) {
  return core::number_text(static_cast<double>(time) / core::kMillisecond, 2) + " ms";
}

}  // namespace

GpioTrigger::GpioTrigger(const TriggerSpec& spec, std::unique_ptr<GpioChips> chips, core::Clock& clock)
    : request_{spec.chip, spec.lines, spec.active_low}, pulse_(spec.pulse), chips_(std::move(chips)), clock_(clock) {
  open();
}

GpioTrigger::~GpioTrigger() {
  let_go();
}

core::Nanoseconds GpioTrigger::fire() {
  if (lines_ == nullptr) reopen(clock_, [this] { open(); });
  try {
    return pulse();
  } catch (...) {
    let_go();
    throw;
  }
}

void GpioTrigger::open() {
  lines_ = chips_->open_outputs(request_);
  try {
    try_reading();
  } catch (...) {
    lines_.reset();
    throw;
  }
}

void GpioTrigger::try_reading() {
  std::string active;
  core::Nanoseconds fastest = 0;
  can_read_ = true;
  try {
    for (int i = 0; i < kReadsTimed; ++i) {
      const core::Nanoseconds start = clock_.now();
      active = lines_against(false);
      const core::Nanoseconds taken = clock_.now() - start;
      fastest = i == 0 ? taken : std::min(fastest, taken);
    }
  } catch (const core::DeviceError&) {  // one that took the request can be written to: it only cannot tell
    can_read_ = false;
  }
  reads_in_pulse_ = can_read_ && fastest <= pulse_;
  if (!active.empty()) {
    throw core::DeviceError(describe(request_) + ": set inactive, but " + active +
                            " reads active: look for a short, another driver of the line, or a wrong active_low");
  }
  if (reads_in_pulse_ || told_) return;
  told_ = true;
  core::note(describe(request_) +
             (can_read_ ? ": reading a line takes " + milliseconds(fastest) + ", longer than the pulse of " +
                              milliseconds(pulse_) + ": only the end of pulses is checked"
                        : std::string(": the chip does not tell the level of outputs: pulses are not checked")));
}

core::Nanoseconds GpioTrigger::pulse() {
  const core::Nanoseconds begin = clock_.now();
  lines_->set(true);
  const core::Nanoseconds set = clock_.now(), end = set + pulse_;
  if (set - begin > kMute) {
    throw core::DeviceError(describe(request_) + ": the chip does not answer: plug it in again");
  }
  const std::string dead = reads_in_pulse_ ? lines_against(true) : "";
  if (pulse_ < kShortPulse) {
    spin_until(clock_, end);
  } else {
    clock_.sleep_until(end);
  }
  lines_->set(false);
  const std::string stuck = can_read_ ? lines_against(false) : "";
  if (dead.empty() && stuck.empty()) return set;
  throw core::DeviceError(describe(request_) + ": " +
                          (dead.empty() ? stuck + " stays active after the pulse" : dead + " does not become active") +
                          ", though the chip took the order: look for a short, or a chip that loses orders");
}

std::string GpioTrigger::lines_against(bool active) {
  const std::vector<bool> levels = lines_->read();
  std::string against;
  for (std::size_t i = 0; i < levels.size(); ++i) {
    if (levels[i] != active) against += (against.empty() ? "line " : ", line ") + request_.lines.at(i);
  }
  return against;
}

void GpioTrigger::let_go() noexcept {
  const core::Nanoseconds deadline = clock_.now() + kMute;
  for (int tries = 0; lines_ != nullptr && tries < kTriesToRest && clock_.now() <= deadline; ++tries) {
    try {
      lines_->set(false);
      if (!can_read_ || clock_.now() > deadline || lines_against(false).empty()) break;
    } catch (...) {  // gone, or failing: what can be done is to try again
    }
  }
  lines_.reset();
}

std::unique_ptr<Trigger> open_gpio_trigger(const TriggerSpec& spec, core::Clock& clock) {
  return std::make_unique<GpioTrigger>(spec, system_gpio_chips(), clock);
}

}  // namespace lightstage::capture
