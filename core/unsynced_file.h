// Files that become durable together. Each sync waits for the disk's journal; syncs that wait at the same time wait for the same one, so that
// many files take little longer than one.
#pragma once

#include <filesystem>
#include <span>
#include <vector>

namespace lightstage::core {

// A file that is written (large ones past the system's cache, where that can be), under a passing name beside its target, and on its way to the disk. Unless it is kept, it goes with this object.
class UnsyncedFile {
 public:
  // Throws BadInput as write_file_atomically.
  UnsyncedFile(std::filesystem::path target, std::span<const unsigned char> bytes);
  UnsyncedFile(UnsyncedFile&& other) noexcept;
  UnsyncedFile& operator=(UnsyncedFile&& other) noexcept;
  ~UnsyncedFile();

  const std::filesystem::path& target() const { return target_; }

  // Syncs the files, moves each to its target (in the place of what stands there), and syncs the targets' folders. Throws BadInput when
  // the disk fails; targets are then as they were, or whole and new.
  static void keep(std::span<UnsyncedFile* const> files);

 private:
  void sync();
  void move_to_target();
  void discard() noexcept;

  std::filesystem::path target_, temporary_;  // temporary_ is empty when there is nothing to remove
  int descriptor_ = -1;                       // open, so that the sync hears of every failure since the first write
};

}  // namespace lightstage::core
