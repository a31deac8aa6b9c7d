// Whether a disk has room for what is about to be written.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>

namespace lightstage::core {

// What stays free for the catalogue's log, for what is small and not counted, and for other programs.
inline constexpr std::uintmax_t kDiskReserve = std::uintmax_t{16} << 20;

// "12.3 MB", "1.4 GB" (powers of ten).
std::string bytes_text(std::uintmax_t bytes);

// Throws StoreError in one line when the file system that holds `folder` has less than `bytes` and the reserve free for this user, saying how much that is:
// "FOLDER: WHAT needs up to 1.4 GB, ...". A quota that the file system does not tell of is not seen. Nothing where it cannot be asked.
void require_room(const std::filesystem::path& folder, std::uintmax_t bytes, const std::string& what);

}  // namespace lightstage::core
