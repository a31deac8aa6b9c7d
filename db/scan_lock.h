// Who works on a scan: one process at a time takes its frames, renders them, or removes it.
#pragma once

#include <filesystem>
#include <string>
#include <string_view>

#include "core/file_descriptor.h"

namespace lightstage::db {

// Held for as long as it lives; the system gives it back when the process dies. Readers need none: a scan can be aligned or relit while
// its frames are being taken. Where the file system knows no locks (flock) nothing is held.
class ScanLock {
 public:
  // Of the scan of that name, which need not be there yet. `work` says in a few words what for ("is being captured", always "is being ..."); others who want the
  // lock meanwhile are told so. Throws StoreError, with the holder's words and process where they can be known, when it is held, when the store's folder cannot
  // be written to, and when something that is no lock stands in its place or in that of the folder `locks` (it is not touched). Never waits.
  ScanLock(const std::filesystem::path& store_folder, std::string_view scan, std::string_view work);
  ~ScanLock();
  ScanLock(const ScanLock&) = delete;
  ScanLock& operator=(const ScanLock&) = delete;

 private:
  std::string name_;             // of the file; gone when nobody holds it, left by a process that was killed
  core::FileDescriptor folder_;  // the store's locks
  core::FileDescriptor file_;
};

}  // namespace lightstage::db
