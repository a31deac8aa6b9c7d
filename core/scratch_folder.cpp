#include "core/scratch_folder.h"

#include <cerrno>
#include <cstring>

#include <stdlib.h>

#include "core/error.h"

namespace lightstage::core {

ScratchFolder::ScratchFolder(const std::filesystem::path& parent) {
  std::string pattern = (parent / ".lightstage-XXXXXX").string();
  if (::mkdtemp(pattern.data()) == nullptr) {
    throw BadInput(pattern + ": cannot make a temporary folder: " + std::strerror(errno));
  }
  path_ = pattern;
}

ScratchFolder::~ScratchFolder() {
  try {
    std::filesystem::remove_all(path_);  // with an error_code it would end the program where memory is short
  } catch (const std::exception&) {
  }
}

}  // namespace lightstage::core
