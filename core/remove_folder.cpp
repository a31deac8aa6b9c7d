#include "core/remove_folder.h"

#include <exception>

namespace lightstage::core {

void remove_folder_quietly(const std::filesystem::path& folder) noexcept {
  try {
    std::filesystem::remove_all(folder);
  } catch (const std::exception&) {
  }
}

}  // namespace lightstage::core
