// A lock that one holder has at a time, among threads and processes of a machine; the system gives it back when a process dies.
#pragma once

#include <filesystem>
#include <optional>

namespace lightstage::core {

class FileLock {
 public:
  // Waits for the lock of this file or folder, which must be there and does not change (flock). Throws BadInput when it cannot be opened. Where the
  // file system knows no locks there is none.
  explicit FileLock(const std::filesystem::path& path);
  // Nothing when somebody holds it.
  static std::optional<FileLock> try_lock(const std::filesystem::path& path);

  FileLock(FileLock&& other) noexcept;
  FileLock& operator=(FileLock&&) = delete;
  ~FileLock();

 private:
  FileLock(const std::filesystem::path& path, bool wait);
  int fd_ = -1;
  bool held_ = false;
};

}  // namespace lightstage::core
