// A disk that loses power: from a record of what a program did to files (shim.cpp), what may be left of them.
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "fault/record.h"

namespace lightstage::fault {

struct Change {
  RecordKind kind = RecordKind::kWrite;
  std::string path, to;  // absolute
  std::uint64_t offset = 0;
  std::string data;
};

// Throws std::runtime_error for a file that is not such a record.
std::vector<Change> read_record(const std::filesystem::path& file);

// The files below one folder, as programs see them and as the disk holds them. Syncing a file makes its contents durable, syncing a folder the names in
// it, which is what POSIX promises and no more. What was not synced may be on the disk or not: of each file any part of the writes (each cut
// at any multiple of 512 bytes), of each folder the first few changes of names (file systems keep their order).
class Disk {
 public:
  // What is below the folder now is durable.
  explicit Disk(const std::filesystem::path& folder);

  void apply(const Change& change);

  // Writes what programs see into another folder.
  void write_seen(const std::filesystem::path& folder) const;
  // Writes what may be left when the power fails now. `seed` chooses; 0: nothing that was not synced.
  void write_left(const std::filesystem::path& folder, std::uint64_t seed) const;

 private:
  struct File {
    std::string durable, seen;
    std::vector<Change> pending;  // kWrite and kTruncate since the last sync
  };
  using Names = std::map<std::string, std::shared_ptr<File>>;  // by path relative to the folder; folders have no file
  struct NameChange {
    Change change;
    std::shared_ptr<File> file;
  };

  std::string relative(const std::string& path) const;
  static void rename(Names& names, const std::string& from, const std::string& to);
  static void apply_to(std::string& bytes, const Change& change, std::uint64_t length);

  std::string root_;
  Names seen_, durable_;
  std::vector<NameChange> pending_names_;
};

}  // namespace lightstage::fault
