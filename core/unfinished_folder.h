// A folder of results that appears only when all of it is there.
#pragma once

#include <filesystem>

namespace lightstage::core {

// A folder beside the target ("NAME.unfinished"), which becomes the target by finish() or is removed with all that is in it.
class UnfinishedFolder {
 public:
  // Throws UsageError when the target is there already and not an empty folder, or an unfinished one lies beside it; BadInput when none can
  // be made.
  explicit UnfinishedFolder(const std::filesystem::path& target);
  ~UnfinishedFolder();
  UnfinishedFolder(const UnfinishedFolder&) = delete;
  UnfinishedFolder& operator=(const UnfinishedFolder&) = delete;

  const std::filesystem::path& path() const { return path_; }
  // Throws BadInput where it cannot be put into place.
  void finish();

 private:
  std::filesystem::path target_, path_;
  bool finished_ = false;
};

}  // namespace lightstage::core
