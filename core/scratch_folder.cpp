#include "core/scratch_folder.h"

#include <cerrno>
#include <cstring>

#include <stdlib.h>

#include "core/error.h"
#include "core/remove_folder.h"

namespace lightstage::core {

ScratchFolder::ScratchFolder(const std::filesystem::path& parent) {
  std::string pattern = (parent / ".lightstage-XXXXXX").string();
  if (::mkdtemp(pattern.data()) == nullptr) {
    throw BadInput(pattern + ": cannot make a temporary folder: " + std::strerror(errno));
  }
  path_ = pattern;
}

ScratchFolder::~ScratchFolder() {
  remove_folder_quietly(path_);
}

}  // namespace lightstage::core
