// A folder that is gone, with all that is in it, when its owner is.
#pragma once

#include <filesystem>

namespace lightstage::core {

class ScratchFolder {
 public:
  // Below `parent`, under a name of its own that starts with a dot. Throws BadInput when it cannot be made.
  explicit ScratchFolder(const std::filesystem::path& parent);
  ~ScratchFolder();
  ScratchFolder(const ScratchFolder&) = delete;
  ScratchFolder& operator=(const ScratchFolder&) = delete;

  const std::filesystem::path& path() const { return path_; }

 private:
  std::filesystem::path path_;
};

}  // namespace lightstage::core
