#include "core/disk_space.h"

#include <array>
#include <cstdio>
#include <system_error>

#include "core/error.h"

namespace lightstage::core {

std::string bytes_text(std::uintmax_t bytes) {
  static constexpr std::array kUnits{"kB", "MB", "GB", "TB", "PB"};
  double value = double(bytes) / 1000;
  std::size_t unit = 0;
  // What would be printed as 1000.0 of one unit is 1.0 of the next.
  while (value >= 999.95 && unit + 1 < kUnits.size()) {
    value /= 1000;
    ++unit;
  }
  char text[32];
  std::snprintf(text, sizeof text, "%.1f %s", value, kUnits.at(unit));
  return text;
}

void require_room(const std::filesystem::path& folder, std::uintmax_t bytes, const std::string& what) {
  std::error_code error;
  const std::uintmax_t free = std::filesystem::space(folder, error).available;
  if (error || (free >= kDiskReserve && free - kDiskReserve >= bytes)) return;
  throw StoreError(folder.string() + ": " + what + " needs up to " + bytes_text(bytes) + " and a reserve of " +
                   bytes_text(kDiskReserve) + ", the disk has " + bytes_text(free) +
                   " free; make room there (`lightstage store gc` removes what nothing refers to) or use another disk");
}

}  // namespace lightstage::core
