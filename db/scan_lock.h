// Who works on a scan: one process at a time takes its frames, renders them, or removes it.
#pragma once

#include <filesystem>
#include <string>
#include <string_view>

namespace lightstage::db {

// Held for as long as it lives; the system gives it back when the process dies. Readers need none: a scan can be aligned or relit while
// its frames are being taken. Where the file system knows no locks (flock) nothing is held.
class ScanLock {
 public:
  // Of the scan of that name, which need not be there yet. `work` says in a few words what for ("is being captured"); others who want the
  // lock meanwhile are told so. Throws StoreError, with the holder's words and process where they can be known, when it is held, and when the store's folder cannot
  // be written to. Never waits.
  ScanLock(const std::filesystem::path& store_folder, std::string_view scan, std::string_view work);
  ~ScanLock();
  ScanLock(const ScanLock&) = delete;
  ScanLock& operator=(const ScanLock&) = delete;

 private:
  std::filesystem::path path_;  // locks/SCAN in the store; gone when nobody holds it, left by a process that was killed
  int fd_ = -1;
};

}  // namespace lightstage::db
