#include "core/clock.h"

#include <cerrno>
#include <cmath>
#include <ctime>

namespace lightstage::core {

double in_units(Nanoseconds time, Nanoseconds unit) {
  return static_cast<double>(time) / static_cast<double>(unit);
}

Nanoseconds from_units(double count, Nanoseconds unit) {
  return std::llround(count * static_cast<double>(unit));
}

Nanoseconds SystemClock::now() const {
  timespec t{};
  clock_gettime(CLOCK_MONOTONIC, &t);
  return Nanoseconds(t.tv_sec) * kSecond + t.tv_nsec;
}

void SystemClock::sleep_until(Nanoseconds time) {
  if (time <= now()) return;
  const timespec t{time / kSecond, time % kSecond};
  while (clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &t, nullptr) == EINTR) {
  }
}

void VirtualClock::sleep_until(Nanoseconds time) {
  // Time never runs backwards, whichever of several sleepers comes last.
  Nanoseconds current = now_.load();
  while (current < time && !now_.compare_exchange_weak(current, time)) {
  }
}

std::string utc_timestamp() {
  const std::time_t now = std::time(nullptr);
  std::tm parts{};
  gmtime_r(&now, &parts);
  char text[32];
  const std::size_t length = std::strftime(text, sizeof text, "%Y-%m-%dT%H:%M:%SZ", &parts);
  return {text, length};
}

}  // namespace lightstage::core
