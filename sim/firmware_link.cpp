#include "sim/firmware_link.h"

#include <algorithm>

namespace lightstage::sim {

void FirmwareLink::schedule_strobe(bool rising, core::Nanoseconds time) {
  strobe_.push_back({rising, time});
}

void FirmwareLink::catch_up() {
  const core::Nanoseconds now = clock_.now();
  for (; !strobe_.empty() && strobe_.front().time <= now; strobe_.pop_front()) {
    firmware_.strobe_edge(strobe_.front().rising, strobe_.front().time);
  }
  firmware_.tick(now);
}

void FirmwareLink::write(std::span<const std::uint8_t> bytes, core::Nanoseconds) {
  catch_up();
  firmware_.receive(bytes, clock_.now());
}

std::vector<std::uint8_t> FirmwareLink::read(core::Nanoseconds deadline) {
  while (true) {
    catch_up();
    std::vector<std::uint8_t> bytes = firmware_.take_output();
    if (!bytes.empty() || clock_.now() >= deadline) return bytes;
    core::Nanoseconds next = deadline;
    if (!strobe_.empty()) next = std::min(next, strobe_.front().time);
    if (const auto event = firmware_.next_event()) next = std::min(next, *event);
    clock_.sleep_until(next);
  }
}

}  // namespace lightstage::sim
