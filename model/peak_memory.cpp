#include "model/peak_memory.h"

#include <malloc.h>

#include <fstream>
#include <sstream>
#include <string>

namespace lightstage::model {

PeakMemory::PeakMemory() {
  ::malloc_trim(0);
  // proc(5): writing 5 sets the peak of the resident set back to what is resident now.
  std::ofstream peak("/proc/self/clear_refs");
  peak << "5" << std::flush;
  counts_anew_ = bool(peak);
}

std::optional<std::size_t> PeakMemory::bytes() const {
  if (!counts_anew_) return std::nullopt;
  constexpr std::size_t kKibibyte = 1024;
  std::ifstream status("/proc/self/status");
  for (std::string line; std::getline(status, line);) {
    std::istringstream words(line);
    std::string name;
    std::size_t kibibytes = 0;
    if (words >> name >> kibibytes && name == "VmHWM:") return kibibytes * kKibibyte;
  }
  return std::nullopt;
}

}  // namespace lightstage::model
