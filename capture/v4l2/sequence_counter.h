// A driver's frame numbers, made to go on for ever.
#pragma once

#include <cstdint>
#include <optional>

namespace lightstage::capture {

// Drivers count frames in 32 bits, which wrap, and from 0 again whenever streaming starts. Gaps, repeats and steps back
// within one stream stay what they are: the difference of two numbers is the driver's own, taken as a signed 32-bit one.
class SequenceCounter {
 public:
  std::int64_t number_of(std::uint32_t driver_number);
  // The stream starts anew: the next frame gets a number above all that were given.
  void restart() { driver_number_.reset(); }

 private:
  std::optional<std::uint32_t> driver_number_;
  std::int64_t number_ = 0;    // of the frame that had driver_number_
  std::int64_t highest_ = -1;  // of all given
};

}  // namespace lightstage::capture
