#include "capture/v4l2/sequence_counter.h"

#include <algorithm>

namespace lightstage::capture {

std::int64_t SequenceCounter::number_of(std::uint32_t driver_number) {
  if (driver_number_) {
    number_ += static_cast<std::int32_t>(driver_number - *driver_number_);
  } else {
    number_ = highest_ + 1;
  }
  driver_number_ = driver_number;
  highest_ = std::max(highest_, number_);
  return number_;
}

}  // namespace lightstage::capture
