// Time is int64 nanoseconds of CLOCK_MONOTONIC, from a Clock that is passed in, so that simulated runs need
// no waiting.
#pragma once

#include <atomic>
#include <cstdint>
#include <string>

namespace lightstage::core {

using Nanoseconds = std::int64_t;
constexpr Nanoseconds kMicrosecond = 1'000;
constexpr Nanoseconds kMillisecond = 1'000'000;
constexpr Nanoseconds kSecond = 1'000'000'000;

// As a decimal number of units, and back, to the nearest nanosecond: below 2^52 ns the rounding of both conversions together
// is less than half a nanosecond, so that times survive the trip through text.
double in_units(Nanoseconds time, Nanoseconds unit);
Nanoseconds from_units(double count, Nanoseconds unit);

class Clock {
 public:
  virtual ~Clock() = default;
  virtual Nanoseconds now() const = 0;
  // Returns at once when the time has passed.
  virtual void sleep_until(Nanoseconds time) = 0;
};

// CLOCK_MONOTONIC itself.
class SystemClock : public Clock {
 public:
  Nanoseconds now() const override;
  void sleep_until(Nanoseconds time) override;
};

// Time that passes only when somebody sleeps.
class VirtualClock : public Clock {
 public:
  Nanoseconds now() const override { return now_.load(); }
  void sleep_until(Nanoseconds time) override;

 private:
  std::atomic<Nanoseconds> now_{0};
};

// Wall-clock time as "2026-01-31T12:34:56Z", for records that people read.
std::string utc_timestamp();

}  // namespace lightstage::core
