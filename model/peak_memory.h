// The most memory that the process has held since a moment, as Linux counts it.
#pragma once

#include <cstddef>
#include <optional>

namespace lightstage::model {

class PeakMemory {
 public:
  // Counts anew from here, once memory that was freed has been given back to the system.
  PeakMemory();

  // The most resident memory of the whole process since then; nothing where the system does not let it count anew (/proc/self/clear_refs).
  std::optional<std::size_t> bytes() const;

 private:
  bool counts_anew_ = false;
};

}  // namespace lightstage::model
