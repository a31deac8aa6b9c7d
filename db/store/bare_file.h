// The bytes of a catalogue's files, past the database.
#pragma once

#include <chrono>
#include <cstddef>
#include <filesystem>
#include <memory>
#include <span>

namespace lightstage::db {

// Reads a file that connections of this process may have open. Closing any descriptor of a file gives back every lock that the process holds on it (POSIX), the
// connections' too: another program that closes the store then takes itself for the last one, and removes the log that we go on writing to
// (https://www.sqlite.org/howtocorrupt.html, section 2.2). So the file is opened and closed by SQLite's own layer, which knows of the locks and waits with closing.
class BareFile {
 public:
  // A file that cannot be opened has no bytes.
  explicit BareFile(const std::filesystem::path& path);
  ~BareFile();
  BareFile(const BareFile&) = delete;
  BareFile& operator=(const BareFile&) = delete;

  // Fills `bytes` from that place on; returns how many there were, fewer at the file's end or where the disk fails.
  std::size_t read(std::size_t offset, std::span<unsigned char> bytes);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

// What others are writing may be there only in part, and no more a moment later: how often to look before it counts, and how long to wait in between.
inline constexpr int kLooks = 20;
inline constexpr std::chrono::milliseconds kBetweenLooks{10};

// While one lives that is true, no connection has the catalogue open, of this process or another, and none can open it: each keeps a lock for as long as it is open.
class NobodyElse {
 public:
  explicit NobodyElse(const std::filesystem::path& catalogue);
  ~NobodyElse();
  NobodyElse(const NobodyElse&) = delete;
  NobodyElse& operator=(const NobodyElse&) = delete;
  explicit operator bool() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace lightstage::db
